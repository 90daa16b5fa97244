"""Certificate authority of a swarm: it issues, revokes and lists the members' certificates."""
