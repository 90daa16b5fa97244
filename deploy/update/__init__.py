"""Updates of a fleet's onboard computers over SSH (docs/nuc.md)."""
