"""Photons in ordinary detectors: scintillators and semiconductors that give a spectrum, and counting tubes.

Independent of the agent, which knows a detector by its table of response alone.
"""
