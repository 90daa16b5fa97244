"""Faults of a simulated flight: which part breaks and when, and how the simulation plays the fault."""
