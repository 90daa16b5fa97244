"""Drones that are not heard: where they may be, and the circle and the ways of the others, clear of them."""
