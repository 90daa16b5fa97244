"""The simulated world in which the agents are tested: sources, detectors, vehicles, localisation errors and a lossy radio."""
