"""Sets of stages: what a drone in one of them does. Tuples, so that their order is the same in every process."""

from __future__ import annotations

from protocol.messages import Stage

ON_GROUND = (Stage.PREFLIGHT, Stage.LANDED)
CIRCLING = (Stage.TRACK, Stage.REACQUIRE)  # the source that has been found, or where it was lost
SEARCHING = (Stage.SURVEY, *CIRCLING)  # looking for sources, or at them
STEERED = (*SEARCHING, Stage.RETURN)  # by setpoints, with separation
DESCENDING = (Stage.LANDING, Stage.ABORT)  # where the drone is
BRAKING = (Stage.HOLD, Stage.LANDING)  # to rest by setpoints, before the autopilot holds or lands
RETURNING = (Stage.RETURN, Stage.LANDING)  # on the way to the end of the flight
FLYING = (Stage.TAKEOFF, *STEERED, Stage.HOLD, *DESCENDING)
TAKING_PART = (Stage.TAKEOFF, *SEARCHING)  # in the search: the area is divided among these
MAY_TAKE_PART = (*TAKING_PART, Stage.HOLD)  # a held drone continues when the operator says so
