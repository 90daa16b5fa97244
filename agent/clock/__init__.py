"""Time from the autopilot for a computer without a clock battery, before the first encrypted link."""
