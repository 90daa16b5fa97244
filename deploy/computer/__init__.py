"""One onboard computer over SSH: the agent installed on an existing system, removed from it, and examined (docs/bench.md)."""
