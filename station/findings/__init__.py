"""The findings of a mission, from its flight records, as files in common formats."""
