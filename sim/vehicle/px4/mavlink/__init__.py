"""The MAVLink links of an emulated PX4."""
