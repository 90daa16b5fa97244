"""Localisation of this drone: its own pose over time and epochs, its frame, and the offsets of the swarm's clocks."""
