"""Missing drones (without a two-way link): their possible positions, and circles, heights and ways clear of them."""
