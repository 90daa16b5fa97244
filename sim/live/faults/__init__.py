"""Faults in a live flight, and random missions with them."""
