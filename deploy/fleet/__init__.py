"""The fleet file: one file from which all drone-specific files are made (docs/nuc.md)."""
