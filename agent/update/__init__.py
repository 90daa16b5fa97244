"""Updates of the onboard computer on board: its two slots, an update on trial, and what came of it (docs/nuc.md)."""
