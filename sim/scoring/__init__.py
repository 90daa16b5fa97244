"""Scores of a simulated flight against the truth: errors of the estimates, local frames, safety, and the theoretical bound."""
