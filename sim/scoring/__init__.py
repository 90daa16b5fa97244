"""Scores of a flight against the truth: errors, frames, safety, and the bound."""
