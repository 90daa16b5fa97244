"""The simulated world around the vehicles: sources, walls, terrain, localisation, satellites, sightings, radio and cameras."""
