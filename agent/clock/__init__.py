"""A computer whose clock has no battery gets its time from the autopilot, before anything can be encrypted."""
