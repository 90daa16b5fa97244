"""The ground below a source: the photons that it scatters to a camera, and the photons of its own radioactivity.

``photons`` transports photons through ground and air; ``field`` tabulates the flux at a camera.
"""
