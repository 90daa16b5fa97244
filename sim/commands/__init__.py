"""The commands of ``radron-sim``."""
