"""Geometry and control: survey, encirclement, trajectory tracker, inter-agent separation, fence."""
