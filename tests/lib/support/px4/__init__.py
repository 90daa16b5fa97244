"""Emulated PX4s, recordings of real ones, and stand-ins for their programs."""
