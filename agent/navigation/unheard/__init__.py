"""Lost and one-way peers: their possible positions, and the circles and ways of the other drones clear of them."""
