"""PX4 as the outside sees it: N emulated vehicles with their MAVLink links, all in one process."""
