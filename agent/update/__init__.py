"""Updates of the onboard computer on board: its two slots, an update on trial, and its outcome (docs/nuc.md)."""
