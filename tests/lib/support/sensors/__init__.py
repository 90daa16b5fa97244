"""Cameras, their event tables, and servers of sensors' lines."""
