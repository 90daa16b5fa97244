"""The other drones, one by one: their messages, checks for a single and true source, and their positions by messages or
sightings.
"""
