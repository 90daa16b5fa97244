"""Views of the station's picture in other programs: Foxglove and TAK."""
