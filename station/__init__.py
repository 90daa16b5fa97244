"""The operator's side: what the swarm knows, live and from its records, as a page in a browser."""
