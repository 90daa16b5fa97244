"""Knowledge about each other drone, beside its messages."""
