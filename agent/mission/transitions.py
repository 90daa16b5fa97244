"""The stage machine as a table of stages and events. ``docs/design/authority.md`` shows it.

An operator's command is an event, too. The other events follow from telemetry and time (``searching.py``, ``stages.py``).
"""

from __future__ import annotations

from enum import StrEnum

from radron.agent.vehicle.interface import Request
from radron.protocol.messages import Action, Stage
from radron.protocol.stages import DESCENDING, FLYING, ON_GROUND, SEARCHING, STEERED


class Event(StrEnum):
    """Causes of a change of the stage besides an operator's command. Of some landings the operator reads the value as cause."""

    LOW = "below the floor, on the way to a stage flown by setpoints"
    SEARCHES = "no source is to be tracked now"
    FOUND = "a source is to be tracked"
    LOST = "the tracked source is lost"
    ENDS = "the search is over or cannot go on, the battery is low, or the drone is revoked"
    ARRIVED = "above home"
    STUCK = "it did not get home: its place is not known, or something kept it away"
    SPENT = "its battery did not last for the way home"
    BLIND = "the position stays lost, or has been lost near the ground"
    SUNK = "its failsafe had brought it near the ground when its agent came back"
    FLOWN_HOME = "somebody else flies it, in return mode"
    FLOWN_DOWN = "somebody else flies it, in land mode"
    FLOWN_HELD = "somebody else flies it, in hold, or has flown it by hand for 3 s"
    TAKEN = "somebody else takes it over, in another mode"
    GROUNDED = "disarmed on the ground"


_S, _E = Stage, Event
ROWS: tuple[tuple[tuple[Stage, ...], Action | Event, Stage | None], ...] = (  # None: the stage that was interrupted
    (ON_GROUND, Action.START, _S.TAKEOFF),
    ((_S.TAKEOFF, *STEERED), Action.HOLD, _S.HOLD),
    ((_S.HOLD,), Action.RESUME, None),
    (FLYING, Action.RETURN, _S.RETURN),
    (FLYING, Action.LAND, _S.LANDING),
    (FLYING, Action.ABORT, _S.ABORT),
    (FLYING, _E.LOW, _S.TAKEOFF),
    ((_S.TAKEOFF, _S.TRACK, _S.REACQUIRE), _E.SEARCHES, _S.SURVEY),
    ((_S.TAKEOFF, _S.SURVEY, _S.REACQUIRE), _E.FOUND, _S.TRACK),
    ((_S.TRACK,), _E.LOST, _S.REACQUIRE),
    ((_S.TAKEOFF, *SEARCHING, _S.HOLD), _E.ENDS, _S.RETURN),
    ((_S.RETURN,), _E.ARRIVED, _S.LANDING),
    ((_S.RETURN,), _E.STUCK, _S.LANDING),
    ((*STEERED, _S.HOLD), _E.SPENT, _S.LANDING),
    ((_S.TAKEOFF, *STEERED, _S.HOLD), _E.BLIND, _S.LANDING),
    ((_S.TAKEOFF, *STEERED), _E.SUNK, _S.LANDING),
    ((*ON_GROUND, _S.TAKEOFF, *SEARCHING, _S.HOLD, *DESCENDING), _E.FLOWN_HOME, _S.RETURN),
    ((*ON_GROUND, _S.TAKEOFF, *STEERED, _S.HOLD, _S.ABORT), _E.FLOWN_DOWN, _S.LANDING),
    ((*ON_GROUND, _S.TAKEOFF, *STEERED, *DESCENDING), _E.FLOWN_HELD, _S.HOLD),
    ((*ON_GROUND, _S.TAKEOFF, *STEERED), _E.TAKEN, _S.HOLD),
    (FLYING, _E.GROUNDED, _S.LANDED),
)
REQUESTS: dict[Stage, Request] = {  # to the autopilot, by stage
    **dict.fromkeys(ON_GROUND, Request.STAY),
    _S.TAKEOFF: Request.TAKEOFF,
    **dict.fromkeys(STEERED, Request.OFFBOARD),
    _S.HOLD: Request.HOLD,
    **dict.fromkeys(DESCENDING, Request.LAND),
}
TABLE = {(stage, event): after for stages, event, after in ROWS for stage in stages}
TO_REST = (Action.HOLD, Action.LAND, Event.SPENT)  # the drone first brakes by setpoints, if it flies by these
REASONS = (Event.STUCK, Event.SPENT, Event.SUNK)  # of a landing
