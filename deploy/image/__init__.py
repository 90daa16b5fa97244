"""The onboard computer's disk: building an image of it, and writing that to a drone's disk (docs/nuc.md)."""
