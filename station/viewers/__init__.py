"""What the station knows, for other programs: Foxglove and TAK."""
