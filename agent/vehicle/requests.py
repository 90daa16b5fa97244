"""How a request of the pilot is brought about: what to ask of the autopilot next, by what its heartbeat shows.

Acknowledgements are not believed (PX4 acknowledges a mode change before it has decided): whatever the heartbeat does not show
is asked for again. A mode that was reached, or that stood when the request came, and then gave way to another one has been
changed by somebody else, a human pilot or a failsafe: it is not asked for again until there is a new request.

A human pilot who took over from one request keeps the vehicle from the next one too, until the pilot program has seen it and
released the vehicle: only what is wanted after that is wanted knowing that a human flies.
"""

from __future__ import annotations

from enum import Enum, auto

from msgspec import Struct

from agent.vehicle.interface import FlightMode, Request

SETTLE_S = 0.3  # a heartbeat that came so long after we asked shows what came of it
REPEAT_S = 1.5  # longer than a heartbeat of 1 Hz and SETTLE_S: between two asks there is one that tells


class Act(Enum):
    """What is asked of the autopilot."""

    SET_TAKEOFF_ALTITUDE = auto()
    ARM = auto()
    TAKE_OFF = auto()
    OFFBOARD = auto()
    HOLD = auto()
    RETURN = auto()
    LAND = auto()


class Seen(Struct, frozen=True):
    """What the autopilot shows. ``heartbeat_s``: when the newest heartbeat came."""

    mode: FlightMode
    armed: bool
    in_air: bool
    failsafe: bool
    heartbeat_s: float


_TARGETS = {
    Request.TAKEOFF: FlightMode.TAKEOFF,
    Request.OFFBOARD: FlightMode.OFFBOARD,
    Request.HOLD: FlightMode.HOLD,
    Request.RETURN: FlightMode.RETURN,
    Request.LAND: FlightMode.LAND,
}
_ACTS = {Request.OFFBOARD: Act.OFFBOARD, Request.HOLD: Act.HOLD, Request.RETURN: Act.RETURN, Request.LAND: Act.LAND}


class Requests:
    """Steps a request towards what the heartbeat is to show."""

    def __init__(self) -> None:
        self._request = Request.STAY
        self._asked_s = float("-inf")
        self._last: Act | None = None
        self._begin(Request.STAY, taken_over=False)

    def step(self, now_s: float, request: Request, seen: Seen, streaming: bool, altitude_set: bool) -> Act | None:
        """What to ask for now, if anything.

        Args:
            now_s: a clock that never goes back.
            request: what the pilot wants; the newest one wins.
            seen: what the autopilot shows.
            streaming: setpoints have been streamed for long enough to be accepted in offboard.
            altitude_set: the autopilot knows the height to take off to.
        """
        if request is not self._request:
            self._begin(request, self._is_taken_over(seen))
        if request not in _TARGETS:
            return None
        if seen.heartbeat_s > self._asked_s + SETTLE_S:
            self._judge(seen)
        act = None if self._yielded else self._wanted(seen, streaming, altitude_set)
        if act is None or (act is self._last and now_s - self._asked_s < REPEAT_S):
            return None
        self._last, self._asked_s = act, now_s
        return act

    def _begin(self, request: Request, taken_over: bool) -> None:
        self._request = request
        self._last = None
        self._mode_before: FlightMode | None = None
        self._was_armed = self._reached = False
        self._yielded = taken_over and request in _TARGETS  # not once it is released

    def _is_taken_over(self, seen: Seen) -> bool:
        """Whether a human pilot has taken the vehicle from the present request."""
        had_it = self._reached or self._yielded or self._mode_before not in (None, FlightMode.MANUAL)
        return seen.armed and seen.mode is FlightMode.MANUAL and had_it

    def _judge(self, seen: Seen) -> None:
        """Whether the request has been reached, or somebody else has chosen otherwise."""
        if not seen.armed:
            self._yielded = self._yielded or self._was_armed  # never armed twice by one request
            return
        self._was_armed = True
        if seen.mode is _TARGETS[self._request]:
            self._reached = True
        elif seen.failsafe and seen.mode is not FlightMode.MANUAL:
            return  # offboard loss: the autopilot comes back by itself once setpoints stream again
        elif self._reached or self._mode_before not in (None, seen.mode):
            self._yielded = True
        self._mode_before = seen.mode

    def _wanted(self, seen: Seen, streaming: bool, altitude_set: bool) -> Act | None:
        request = self._request
        if request is Request.TAKEOFF:
            return self._takeoff(seen, altitude_set)
        if not seen.armed or seen.mode is _TARGETS[request]:
            return None
        if request is Request.OFFBOARD and not (seen.in_air and streaming and not seen.failsafe):
            return None
        return _ACTS[request]

    def _takeoff(self, seen: Seen, altitude_set: bool) -> Act | None:
        if seen.in_air or (seen.armed and seen.mode is FlightMode.TAKEOFF):
            return None
        if not altitude_set:
            return Act.SET_TAKEOFF_ALTITUDE
        return Act.TAKE_OFF if seen.armed else Act.ARM
