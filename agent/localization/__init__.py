"""Where this drone is: its own pose over time and epochs, the frame it is in, and how far the swarm's clocks differ."""
