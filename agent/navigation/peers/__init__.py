"""The other drones, one by one: what they tell, whether it is of one source and true, and where each is by it or by sightings."""
