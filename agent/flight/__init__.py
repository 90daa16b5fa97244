"""The flight recorder, which records all inputs and outputs of a pilot, and the replay that verifies them bit for bit."""
