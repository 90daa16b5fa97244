"""Emulated PX4: N vehicles with their MAVLink links, all in one process."""
