"""Recorded surveys with ordinary detectors: CSV files, their check, and their fold without a flight."""
