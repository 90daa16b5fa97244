"""The findings of a mission, from its flight records, as files that others can read."""
