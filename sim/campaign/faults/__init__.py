"""Random missions with faults: drawn from a seed, flown, judged by conditions that must hold, and reduced where they fail."""
