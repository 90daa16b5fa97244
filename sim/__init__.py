"""What reality would give: sources, detectors, vehicles, localisation errors, bad radio."""
