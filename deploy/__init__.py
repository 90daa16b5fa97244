"""The way onto the drones; knows only the protocol."""
