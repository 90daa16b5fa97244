"""Pixel hits -> clusters -> coincidences -> cones."""
