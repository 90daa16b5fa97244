"""The swarm's certificate authority: issuing, revoking and showing certificates."""
