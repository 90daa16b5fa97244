"""The flight recorder: everything that a pilot was given and what it made of it, and the proof that it would do so again."""
