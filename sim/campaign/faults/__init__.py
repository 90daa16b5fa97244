"""Random missions with faults: drawn from a seed, flown, judged by invariants, and made smaller where they fail."""
