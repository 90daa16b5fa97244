"""Simulated flights in lockstep: the whole swarm in one process, faster than real time, repeatable from a seed.

All agents (the complete onboard software) and the world make their time steps together.
"""
