"""The way onto the drones; knows only the protocol. Nothing is here yet."""
