"""The truth around the vehicles: sources, walls, terrain, localisation errors, satellites, sightings, radio, cameras."""
