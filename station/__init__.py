"""The operator's side: the swarm's state and findings, live and from records, as a page in a browser."""
