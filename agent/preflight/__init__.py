"""The preflight check: parts that are ready for a flight, not yet ready, or failed."""
