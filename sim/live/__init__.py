"""Live flights: the agents as real processes, linked by real Zenoh and MAVLink, in real time."""
