"""Sources and detectors: nuclides, photon transport in CdTe, the Timepix3's response; from a source in view to pixel hits.

``camera.Camera`` is used in flights: fast, from a bank of simulated events. ``beam.BeamCamera`` transports every photon.
"""
