"""The ground below a source: which photons it scatters to a camera, and which it sends out by itself.

``photons`` transports photons through ground and air; ``field`` tabulates the flux at a camera.
"""
