"""Groups of mission stages by what a drone does in them, such as all stages in flight.

The groups are tuples, so that their order is the same in every process.
"""

from __future__ import annotations

from radron.protocol.messages import Stage

ON_GROUND = (Stage.PREFLIGHT, Stage.LANDED)
CIRCLING = (Stage.TRACK, Stage.REACQUIRE)  # around the found source, or around the place of its loss
SEARCHING = (Stage.SURVEY, *CIRCLING)  # search for sources, or observation of a source
STEERED = (*SEARCHING, Stage.RETURN)  # by setpoints, with separation
DESCENDING = (Stage.LANDING, Stage.ABORT)  # at the drone's own position
BRAKING = (Stage.HOLD, Stage.LANDING)  # to rest by setpoints, before the autopilot holds or lands
RETURNING = (Stage.RETURN, Stage.LANDING)  # on the way to the end of the flight
FLYING = (Stage.TAKEOFF, *STEERED, Stage.HOLD, *DESCENDING)
TAKING_PART = (Stage.TAKEOFF, *SEARCHING)  # in the search: the area is divided among these drones
MAY_TAKE_PART = (*TAKING_PART, Stage.HOLD)  # a held drone continues at the operator's command
