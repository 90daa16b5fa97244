"""The operator's commands to a swarm, from a terminal or a station: sent, and followed until they are obeyed."""
