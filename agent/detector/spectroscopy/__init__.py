"""Gamma spectroscopy: which nuclides a camera sees by the spectrum of its events, and its energy scale by their lines."""
