"""Relays that impair the links of a live flight: between the agents, and between vehicles and agents."""
