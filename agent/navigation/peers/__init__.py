"""The other drones, one by one: their newest messages, the check that these come from one sender, and their positions by messages
or sightings.
"""
