"""Campaigns: many simulated flights on all cores or on a cluster, and their statistics."""
