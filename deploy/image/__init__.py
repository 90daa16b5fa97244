"""The onboard computer's disk: build of its image, and writing of the image to a drone's disk (docs/nuc.md)."""
