"""Emulation of PX4 for live flights: N vehicles with their MAVLink links, all in one process."""
