"""The mission of one drone: stages, world model, reports, and the state kept over a restart."""
