"""The camera's files: measurements of pixel hits, calibrations."""
