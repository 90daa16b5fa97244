"""Keeping a fleet's onboard computers updated over SSH (docs/nuc.md)."""
