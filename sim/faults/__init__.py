"""Faults as data: what breaks in a flight, when, and how the simulation plays it."""
