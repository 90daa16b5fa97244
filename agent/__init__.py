"""One drone, on board: ``pilot`` is the brain without I/O, ``shell`` the process around it.

detector       pixel hits to clusters, coincidences and cones; drivers
sensing        detections, fixes and sightings to log entries: ``observer`` turns a cone into one
localization   the own pose: where this drone was, and in which epoch of its local frame
frames         whose coordinates are these: all local frames as a function of the log
fusion         the observation log, and the estimators that turn it into a hypothesis
terrain        the ground on which the source lies
mission        stages; who flies (takeover, failsafe), by the autopilot's mode; what is told of it
navigation     from what a drone knows to what it flies next
motion         geometry and control: survey, encirclement, tracker, ``separation``, fence
vehicle        PX4 through MAVSDK: telemetry, requests, ``modes``
computing      computations whose results agents with equal logs may share, in simulations
flight         flight recorder, replay, identification of the vehicle's response
preflight      what is ready, not yet, or failed
config         mission and drone files
"""
