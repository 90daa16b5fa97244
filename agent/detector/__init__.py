"""The detection chain: pixel hits -> clusters -> coincidences -> cones."""
