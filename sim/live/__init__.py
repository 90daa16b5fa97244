"""The swarm as real processes over real Zenoh and MAVLink, in real time."""
