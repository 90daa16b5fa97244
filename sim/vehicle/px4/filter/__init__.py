"""Emulation of PX4's estimator: local frame, satellites and vision."""
