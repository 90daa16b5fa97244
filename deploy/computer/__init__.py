"""One onboard computer, reached over SSH: installation of the agent on an existing system, removal and examination.

See docs/bench.md.
"""
