"""Judges PX4's mode and state from its heartbeat, and chooses the next command that fulfils the pilot's request.

Acknowledgements are not relied on (PX4 acknowledges a mode change before it has decided). A command is repeated until the
heartbeat shows its effect. A change away from a mode that was reached, or was active when the request came, is a takeover by a
pilot or a failsafe. The mode is then not commanded again until there is a new request.

In a failsafe the heartbeat shows the mode of the failsafe, and CURRENT_MODE the mode to go back to once its cause is over. A mode
that only a failsafe flies has not been reached: it is commanded until the autopilot goes back to it. Offboard is an exception:
setpoints alone end the failsafe for want of them, and other failsafes are to be obeyed. After a release offboard is commanded for
a moment, until acknowledged, at the wish of an operator, who can see the failsafe. A failsafe for want of a ground station or
battery, or at the fence, ends only by a chosen mode.

Transitions by the autopilot itself are no takeovers. After its takeoff it changes to hold, and a heartbeat up to a second old may
still show the hold before that takeoff. After a landing the autopilot goes back to the previous mode, and cannot be armed in
offboard: hold is commanded then.

After a takeover the pilot keeps the vehicle also against the next request, until the pilot program has noticed and released it.
Only later requests account for the takeover. The same holds for a takeover during a lost link. A manual mode that the newest
heartbeat did not show when the request came is a takeover. After some time without a link nothing is commanded. By then a
failsafe flies the vehicle, or a pilot, who would lose it again and again.
"""

from __future__ import annotations

from enum import Enum, auto

from msgspec import Struct

from radron.agent.vehicle.interface import FlightMode, Request

SETTLE_S = 0.3  # a heartbeat this long after a command shows its effect
URGENT_S = 0.4  # between two commands in a failsafe, which may end at any moment
DISARMED_S = 1.5  # heartbeats this far apart, and no contrary one in between: one forged packet does not count
# Period and duration of repeating a command that ends offboard, until acknowledged. The setpoints have ended, and after a second
# without them PX4 returns.
UNACKED_S, _LOST_S = 0.2, 1.0
# After this time with neither a heartbeat nor a new request, nothing is commanded: PX4 notices after a second that no setpoints
# come.
BLIND_S = 3.0
OVERRULE_S = 1.5  # limit of asking for offboard in a failsafe after an operator's command, until acknowledged
REPEAT_S = 1.5  # between two commands: longer than the heartbeat's period of 1 s plus SETTLE_S


class Act(Enum):
    """A single command to the autopilot, by which a request of the pilot program is brought about."""

    SET_TAKEOFF_ALTITUDE = auto()
    ARM = auto()
    DISARM = auto()
    TAKE_OFF = auto()
    OFFBOARD = auto()
    HOLD = auto()
    RETURN = auto()
    LAND = auto()


class Seen(Struct, frozen=True):
    """The mode and state shown by the autopilot.

    ``heartbeat_s``: arrival of the newest heartbeat; ``intended``: the mode that follows after a failsafe, None if not reported.
    """

    mode: FlightMode
    armed: bool
    in_air: bool
    failsafe: bool
    heartbeat_s: float
    intended: FlightMode | None = None


TARGETS = {  # the mode that a request is for
    Request.TAKEOFF: FlightMode.TAKEOFF,
    Request.OFFBOARD: FlightMode.OFFBOARD,
    Request.HOLD: FlightMode.HOLD,
    Request.RETURN: FlightMode.RETURN,
    Request.LAND: FlightMode.LAND,
}
_OWN = (FlightMode.HOLD, FlightMode.TAKEOFF)  # between these the autopilot changes by itself
_NOT_ARMABLE = (FlightMode.OFFBOARD, FlightMode.RETURN, FlightMode.LAND)
_ACTS = {Request.OFFBOARD: Act.OFFBOARD, Request.HOLD: Act.HOLD, Request.RETURN: Act.RETURN, Request.LAND: Act.LAND}


class Requests:
    """Chooses and repeats the commands to the autopilot until its heartbeat shows the mode that the pilot program requests."""

    def __init__(self) -> None:
        self._request = Request.STAY
        self._asked_s = self._first_s = float("-inf")  # when the last command was sent, now and first
        self._is_acked = False
        self._last: Act | None = None
        self._was_armed = self._yielded = False
        self._begin(Request.STAY, float("-inf"), by_hand=False, taken_over=False)

    def step(self, now_s: float, request: Request, seen: Seen, streaming: bool, altitude_set: bool) -> Act | None:
        """Return the command to send to the autopilot now; None if there is none.

        Args:
            now_s: a clock that never goes back.
            request: of the pilot program; the newest wins.
            seen: mode and state shown by the autopilot.
            streaming: setpoints have been streamed for long enough to be accepted in offboard.
            altitude_set: the autopilot knows the height to take off to.
        """
        if request is not self._request:
            by_hand = seen.mode is FlightMode.MANUAL
            self._begin(request, now_s, by_hand=by_hand, taken_over=self._is_taken_over(seen))
        is_blind = now_s - max(seen.heartbeat_s, self._begun_s) > BLIND_S
        if request is Request.STAY:
            return self._asked(now_s, Act.HOLD if _must_hold(seen) and not is_blind else None, REPEAT_S)
        if request is Request.DISARM:
            stands = seen.armed and not seen.in_air and not is_blind
            return self._asked(now_s, Act.DISARM if stands else None, REPEAT_S)
        if request not in TARGETS:
            return None
        self._was_armed = self._was_armed or seen.armed  # however soon after the command a heartbeat shows it
        if seen.heartbeat_s > self._asked_s + SETTLE_S:
            self._judge(seen)
        overrules = self._is_ordered and not self._is_acked and now_s - self._begun_s < OVERRULE_S
        can_steer = seen.in_air and streaming and (overrules or not seen.failsafe)
        act = None if self._yielded or is_blind else self._wanted(seen, can_steer, altitude_set)
        leaves = seen.mode is FlightMode.OFFBOARD and act in (Act.HOLD, Act.LAND)
        is_lost = leaves and not self._is_acked and now_s - self._first_s < _LOST_S
        return self._asked(now_s, act, UNACKED_S if is_lost else URGENT_S if seen.failsafe else REPEAT_S)

    def acked(self) -> None:
        """Note that the autopilot has received the last command, whatever the result of the command."""
        self._is_acked = True

    def _asked(self, now_s: float, act: Act | None, repeat_s: float) -> Act | None:
        """Return the command if it is time to send it."""
        if act is None or (act is self._last and now_s - self._asked_s < repeat_s):
            return None
        if act is not self._last or now_s - self._asked_s >= REPEAT_S:
            self._first_s, self._is_acked = now_s, False
        self._last, self._asked_s = act, now_s
        return act

    def _begin(self, request: Request, now_s: float, *, by_hand: bool, taken_over: bool) -> None:
        self._is_ordered = self._request is Request.RELEASE  # only an operator ends that in the air
        self._request, self._begun_s = request, now_s
        self._last, self._is_acked = None, False
        self._mode_before: FlightMode | None = None
        self._by_hand = by_hand  # manual mode since before the request
        self._was_armed = self._reached = False
        self._disarmed_s = float("inf")  # arrival of the first of the heartbeats in a row that show it
        self._yielded = taken_over and request in TARGETS  # not once it is released

    def _is_taken_over(self, seen: Seen) -> bool:
        """Whether a pilot has taken over the vehicle from the present request."""
        had_it = self._reached or self._yielded or not self._by_hand
        return self._request in TARGETS and seen.armed and seen.mode is FlightMode.MANUAL and had_it

    def _judge(self, seen: Seen) -> None:
        """Judge whether the request has been reached, or overruled by a takeover."""
        if not seen.armed:
            self._disarmed_s = min(self._disarmed_s, seen.heartbeat_s)
            if self._was_armed and seen.heartbeat_s >= self._disarmed_s + DISARMED_S:
                self._yielded = True
            return
        self._disarmed_s = float("inf")
        takes_over = seen.mode is FlightMode.MANUAL and not self._by_hand
        self._by_hand = seen.mode is FlightMode.MANUAL
        if seen.failsafe and not self._by_hand:
            return  # offboard loss: the autopilot resumes by itself once setpoints are streamed again
        before = self._mode_before
        by_itself = not self._reached and seen.mode in _OWN and before in _OWN
        if seen.mode is TARGETS[self._request]:
            self._reached = True
        elif self._reached or takes_over or (before not in (None, seen.mode) and not by_itself):
            self._yielded = True
        self._mode_before = seen.mode

    def _wanted(self, seen: Seen, can_steer: bool, altitude_set: bool) -> Act | None:
        request = self._request
        if self._was_armed and not seen.armed:
            return None  # never arm twice for one request
        if request is Request.TAKEOFF:
            return self._takeoff(seen, altitude_set)
        if not seen.armed or self._is_there(seen):
            return None
        if request is Request.OFFBOARD and not can_steer:
            return None
        return _ACTS[request]

    def _is_there(self, seen: Seen) -> bool:
        """Whether the requested mode is active, and in a failsafe also the mode to go back to."""
        target = TARGETS[self._request]
        if seen.failsafe and seen.intended is not None and self._request is not Request.OFFBOARD:
            return seen.intended is target
        return seen.mode is target

    def _takeoff(self, seen: Seen, altitude_set: bool) -> Act | None:
        if seen.in_air or (seen.armed and seen.mode is FlightMode.TAKEOFF):
            return None
        if _must_hold(seen):
            return Act.HOLD
        if not altitude_set:
            return Act.SET_TAKEOFF_ALTITUDE
        return Act.TAKE_OFF if seen.armed else Act.ARM


def _must_hold(seen: Seen) -> bool:
    """Whether the autopilot is on the ground in a mode in which it cannot be armed."""
    return not seen.armed and not seen.in_air and seen.mode in _NOT_ARMABLE
