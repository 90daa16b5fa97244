"""The station's data in other programs: Foxglove and TAK."""
