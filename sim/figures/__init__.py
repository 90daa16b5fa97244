"""Figures of simulated flights and campaigns.

Each function makes a Matplotlib figure and shows nothing; ``style.save`` writes it.
"""
