"""The swarm's certificate authority: issue, revocation and list of certificates."""
