"""One drone, on board: ``pilot`` is the brain without I/O, ``shell`` the process around it.

detector       pixel hits to clusters, coincidences and cones; drivers
sensing        detections, fixes and sightings to log entries: ``observer`` turns a cone into one
localization   the own pose: this drone's positions, with the epoch of its local frame
frames         all local frames in the mission frame, as a function of the log
fusion         the observation log, and the estimators that turn it into a hypothesis
terrain        the ground below the source
mission        stages; authority (takeover, failsafe), by the autopilot's mode; statuses and reports
navigation     from a drone's knowledge to its next plan
motion         geometry and control: survey, encirclement, tracker, ``separation``, fence
vehicle        PX4 through MAVSDK: telemetry, requests, ``modes``
computing      computations whose results agents with equal logs may share, in simulations
flight         flight recorder, replay, identification of the vehicle's response
preflight      checks: ready, not yet ready, or failed
config         mission and drone files
"""
