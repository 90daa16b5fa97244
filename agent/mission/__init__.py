"""The mission of one drone: its stages, its world model, what it reports, and what survives a restart."""
