"""Faults in live flights, and random missions with faults."""
