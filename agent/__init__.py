"""One drone, on board."""
