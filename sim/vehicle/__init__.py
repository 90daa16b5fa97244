"""Simulated multirotors: their dynamics, and the behaviour of the autopilot PX4."""
