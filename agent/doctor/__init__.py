"""Checks of a drone on the bench for a technician: the preflight check, the computer and its links."""
