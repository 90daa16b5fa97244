"""Multirotor dynamics and PX4's behaviour."""
