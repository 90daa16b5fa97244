"""The fleet file: one file from which everything that is particular to a drone is made (docs/nuc.md)."""
