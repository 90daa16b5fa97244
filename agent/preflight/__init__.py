"""The preflight check: what is ready for a flight, not yet ready, or failed."""
