"""The other drones: what is known of each."""
