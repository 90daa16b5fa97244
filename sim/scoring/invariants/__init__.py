"""Conditions that must hold in every simulated flight, whatever breaks; they are judged from the truth at each time step."""
