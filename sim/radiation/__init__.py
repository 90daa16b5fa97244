"""Simulated sources and detectors: nuclides, photon transport in CdTe, and the Timepix3's response.

The input is a source in view of a camera, the output are pixel hits. ``camera.Camera`` is used in flights: it is fast, as it
draws from stored simulated events. ``beam.BeamCamera`` transports every photon.
"""
