"""The authority over one vehicle: the table of its states and events, and the events in a piece of telemetry.

The vehicle is flown by the agent (``ASKED`` to ``REJOINED``), or by a pilot, a ground station or the autopilot's failsafe
(``RELEASED``). Only the autopilot's mode distinguishes them, and its heartbeat is up to a second old. So a mode that the agent
has not asked for counts only after it has lasted, and the agent's own requests explain some modes: see ``_is_foreign``.
``docs/design/authority.md`` shows the table.
"""

from __future__ import annotations

from enum import StrEnum

from msgspec import Struct
from msgspec.structs import replace

from radron.agent.lasting import since
from radron.agent.mission.flight import Flight
from radron.agent.mission.transitions import REQUESTS
from radron.agent.vehicle.grounded import STILL_NS
from radron.agent.vehicle.interface import FlightMode, Request, VehicleState
from radron.agent.vehicle.requests import TARGETS
from radron.protocol.codes import Code
from radron.protocol.messages import Stage
from radron.protocol.stages import DESCENDING, STEERED
from radron.protocol.texts import CodedText

TAKEOVER_NS = 1_500_000_000  # a heartbeat is up to 1 s old: wait longer before taking a mode for a takeover
FAILSAFE_NS = 3_000_000_000  # the same for a failsafe, which may pass
# The same for a hold in a landing: after touchdown the autopilot shows a hold until the landing is confirmed.
TOUCHDOWN_NS = STILL_NS + TAKEOVER_NS
REGAIN_NS = 5_000_000_000  # limit for getting the vehicle out of a failsafe, or of a hold
STALE_NS = 1_200_000_000  # greatest age of the mode in a heartbeat
OWN_HOLD_NS = 3_000_000_000  # a hold that this agent has asked for is shown within this time
UNFOLLOWED_NS = 3_000_000_000  # a vehicle that does not follow its agent for longer is reported
# An autopilot ends its takeoff by itself this far below its height at most: 0.5 to 1.0 m in 20 recorded takeoffs (NAV_MC_ALT_RAD
# is 0.8 m). Nothing else distinguishes its hold from a pilot's: mode, intended mode, landed state and events are the same.
CUT_SHORT_M = 1.5


class State(StrEnum):
    """The holder of the authority."""

    ASKED = "asked"  # the agent; the autopilot has not shown yet the mode that was asked for, and a hold is no takeover
    AGENT = "agent"  # the agent; the autopilot has shown that mode, and a hold is a takeover
    OWN_HOLD = "own hold"  # the agent, which has asked for this hold for want of telemetry
    REGAINING = "regaining"  # the agent, on its way out of its own hold, or of a failsafe
    REJOINED = "rejoined"  # the agent, restarted in flight, on its way out of a failsafe
    RELEASED = "released"  # a pilot, a ground station or a failsafe; the agent sends nothing


class Event(StrEnum):
    """Causes of a change of the authority."""

    ASKS = "the agent changes to or from setpoints, or an operator repeats a command"
    HOLD_ASKED = "no recent telemetry: the agent asks for a hold"
    REGAINS = "the position is trusted again, or the agent was restarted in its own hold"
    RESTARTED = "the agent was restarted in flight"
    SHOWN = "the autopilot shows a mode of the stage"
    REACHED = "the autopilot shows the mode asked for, in a heartbeat from after that"
    HOLD_LEFT = "3 s after it was asked for, the autopilot is not in that hold, or not any more"
    TIME_UP = "5 s are over"
    OVERRULED = "a mode that the agent has not asked for has lasted"
    COMMANDED = "an operator's command is obeyed"
    GROUNDED = "the vehicle is disarmed on the ground"


_A, _E = State, Event
ROWS: tuple[tuple[tuple[State, ...], Event, State], ...] = (
    ((_A.AGENT, _A.OWN_HOLD), _E.ASKS, _A.ASKED),
    ((_A.REJOINED,), _E.ASKS, _A.REGAINING),
    ((_A.AGENT, _A.OWN_HOLD), _E.HOLD_ASKED, _A.OWN_HOLD),
    ((_A.REJOINED,), _E.HOLD_ASKED, _A.REGAINING),
    ((_A.ASKED, _A.AGENT, _A.OWN_HOLD, _A.REGAINING, _A.REJOINED), _E.REGAINS, _A.REGAINING),
    ((_A.ASKED,), _E.RESTARTED, _A.REJOINED),
    ((_A.REGAINING,), _E.SHOWN, _A.ASKED),
    ((_A.REJOINED,), _E.SHOWN, _A.AGENT),
    ((_A.ASKED, _A.OWN_HOLD, _A.REGAINING, _A.REJOINED), _E.REACHED, _A.AGENT),
    ((_A.OWN_HOLD,), _E.HOLD_LEFT, _A.AGENT),
    ((_A.REGAINING,), _E.TIME_UP, _A.ASKED),
    ((_A.REJOINED,), _E.TIME_UP, _A.AGENT),
    ((_A.ASKED, _A.AGENT, _A.OWN_HOLD, _A.REGAINING, _A.REJOINED), _E.OVERRULED, _A.RELEASED),
    ((_A.RELEASED,), _E.COMMANDED, _A.ASKED),
    ((_A.AGENT, _A.OWN_HOLD, _A.REGAINING, _A.REJOINED, _A.RELEASED), _E.GROUNDED, _A.ASKED),
)
TABLE = {(state, event): after for states, event, after in ROWS for state in states}

MODES: dict[Stage, tuple[FlightMode, ...]] = {  # of the autopilot, by stage; the final mode last
    **{stage: (TARGETS[request],) for stage, request in REQUESTS.items() if request in TARGETS},
    Stage.TAKEOFF: (FlightMode.TAKEOFF, FlightMode.HOLD, FlightMode.OFFBOARD),  # the last metres by setpoints
}


def is_failsafe(vehicle: VehicleState) -> bool:
    """Whether the autopilot brings the vehicle home or down without a request."""
    return vehicle.mode in (FlightMode.RETURN, FlightMode.LAND) and not vehicle.healthy


def is_elsewhere(vehicle: VehicleState | None, request: Request) -> bool:
    """Whether the autopilot is in another mode than requested; False in manual mode: a pilot at the sticks keeps the vehicle."""
    if vehicle is None or not vehicle.healthy or vehicle.mode is FlightMode.MANUAL:
        return False
    return vehicle.mode is not TARGETS.get(request, vehicle.mode)


def is_cut_short(vehicle: VehicleState, height_m: float) -> bool:
    """Whether a takeoff to a height above the launch place has ended long before, because a pilot or a ground station has chosen
    another mode.
    """
    return vehicle.in_air and vehicle.position_trusted and vehicle.position_m[2] < height_m - CUT_SHORT_M


class View(Struct, frozen=True):
    """One piece of telemetry, and the flight by then. ``cut_short``: its takeoff has ended long before its height."""

    vehicle: VehicleState
    now_ns: int
    flight: Flight
    cut_short: bool = False

    @property
    def modes(self) -> tuple[FlightMode, ...]:
        """The modes of the stage, the final mode last."""
        return (FlightMode.OFFBOARD,) if self.flight.is_steered else MODES[self.flight.stage]


class Authority(Struct, frozen=True):
    """The authority over one vehicle at a time; each method returns the following value.

    ``since_ns``: begin of the state. ``held_ns``: when this agent last asked for a hold for want of telemetry. ``unheard_ns``:
    the last time without recent telemetry, until some comes. ``foreign_since_ns``: begin of a mode that the agent has not asked
    for. ``mode``: the autopilot's, shown since ``mode_since_ns``, or the release. ``unfollowed_since_ns``: since when the vehicle
    has been released, or the autopilot not in offboard although the stage requires it.
    """

    state: State = State.ASKED
    since_ns: int = 0
    held_ns: int | None = None
    unheard_ns: int | None = None
    foreign_since_ns: int | None = None
    mode: FlightMode = FlightMode.HOLD
    mode_since_ns: int | None = None
    unfollowed_since_ns: int | None = None

    @property
    def is_released(self) -> bool:
        """Whether a pilot, a ground station or a failsafe flies the vehicle."""
        return self.state is State.RELEASED

    @property
    def owns_hold(self) -> bool:
        """Whether a hold that the autopilot shows is this agent's own, or no takeover."""
        return self.state in (State.ASKED, State.OWN_HOLD, State.REGAINING)

    def is_heard_again(self, vehicle: VehicleState) -> bool:
        """Whether this is the first telemetry after a time without."""
        return self.unheard_ns is not None and vehicle.stamp_ns > self.unheard_ns

    def after(self, event: Event | None, now_ns: int) -> Authority:
        """Take an event; without a row for this state and event nothing changes."""
        if event is None or (self.state, event) not in TABLE:
            return self
        state = TABLE[self.state, event]
        if state is State.RELEASED:
            return replace(self, state=state, since_ns=now_ns, mode_since_ns=None)
        return replace(self, state=state, since_ns=now_ns, foreign_since_ns=None if self.is_released else self.foreign_since_ns)

    def asks(self, now_ns: int) -> Authority:
        """Note that the request to the autopilot changes to or from setpoints, or is repeated."""
        return replace(self.after(Event.ASKS, now_ns), foreign_since_ns=None)

    def commanded(self, now_ns: int) -> Authority:
        """Note that an operator's command is obeyed. Reports of the time before it end."""
        return replace(self.after(Event.COMMANDED, now_ns), unfollowed_since_ns=None)

    def unheard(self, now_ns: int, *, holds: bool) -> Authority:
        """There is no recent telemetry; ``holds``: the agent asks for a hold."""
        if not holds:
            return replace(self, unheard_ns=now_ns)
        return replace(self.after(Event.HOLD_ASKED, now_ns), unheard_ns=now_ns, held_ns=now_ns)

    def rejoin(self, view: View, *, holds: bool) -> Authority:
        """Continue a flight in which this agent was restarted.

        Without setpoints the autopilot returns or lands in its failsafe (``healthy`` is False then), and goes back to offboard
        when they resume. In a hold it stays. ``holds``: ``owns_hold`` when the agent was ended.
        """
        vehicle, stage = view.vehicle, view.flight.stage
        is_reached = stage is not Stage.TAKEOFF and not (holds and vehicle.mode is FlightMode.HOLD)
        there = self.after(Event.REACHED, view.now_ns) if is_reached else self
        if vehicle.mode is FlightMode.MANUAL or (vehicle.healthy and there._is_foreign(view)):  # no failsafe led to it
            return self.after(Event.OVERRULED, view.now_ns)
        if stage in STEERED or (stage is Stage.TAKEOFF and is_failsafe(vehicle)):
            return self.after(Event.RESTARTED if is_reached else Event.REGAINS, view.now_ns)
        return there

    def seen(self, mode: FlightMode, now_ns: int, *, steered: bool) -> Authority:
        """Note the autopilot's mode, for the report; ``steered``: the agent wants it in offboard."""
        lacks = self.is_released or (steered and mode is not FlightMode.OFFBOARD)
        unfollowed_ns = since(self.unfollowed_since_ns, now_ns, holds=lacks)
        mode_ns = since(self.mode_since_ns if mode is self.mode else None, now_ns, holds=True)
        if (mode, mode_ns, unfollowed_ns) == (self.mode, self.mode_since_ns, self.unfollowed_since_ns):
            return self
        return replace(self, mode=mode, mode_since_ns=mode_ns, unfollowed_since_ns=unfollowed_ns)

    def judged(self, view: View) -> Authority:
        """Judge whether the vehicle has been taken over. A failsafe is given time to pass: the autopilot goes back to offboard
        when setpoints resume.
        """
        now_ns = view.now_ns
        judged = self.after(self._event(view), now_ns)
        foreign_ns = since(judged.foreign_since_ns, now_ns, holds=judged._is_foreign(view))
        if foreign_ns != judged.foreign_since_ns:
            judged = replace(judged, foreign_since_ns=foreign_ns)
        lasts = foreign_ns is not None and now_ns - foreign_ns > _patience_ns(view)
        return judged.after(Event.OVERRULED, now_ns) if lasts else judged

    def mode_lasts(self, now_ns: int) -> bool:
        """Whether the autopilot has been in its mode for long enough to be reported. A failsafe for want of battery holds before
        it returns, and a pilot may cancel it. The others plan by the last stage that is published.
        """
        return self.mode_since_ns is not None and now_ns - self.mode_since_ns >= FAILSAFE_NS

    def problem(self, now_ns: int) -> CodedText | None:
        """Return the message to the operator on a vehicle that does not follow its agent; None while it does."""
        if self.unfollowed_since_ns is None or now_ns - self.unfollowed_since_ns < UNFOLLOWED_NS:
            return None
        lasts = f"for {(now_ns - self.unfollowed_since_ns) * 1e-9:.0f} s"
        if self.is_released:
            text = f"under the control of a human pilot or of its failsafe: the autopilot has been in {self.mode} {lasts}"
            return CodedText(Code.MANUAL_CONTROL, text)
        text = f"not following its mission: the autopilot has been in {self.mode}, not in offboard, {lasts}"
        return CodedText(Code.MODE_NOT_FOLLOWED, text)

    def _event(self, view: View) -> Event | None:
        """Derive the event from telemetry and time."""
        now_ns, mode = view.now_ns, view.vehicle.mode
        held = self.held_ns is not None and now_ns - self.held_ns < OWN_HOLD_NS
        is_stale = view.flight.position_loss.stays or held or now_ns - view.flight.since_ns <= STALE_NS
        if view.cut_short or (mode is view.modes[-1] and not is_stale):
            return Event.REACHED
        if self.state is State.OWN_HOLD:
            return Event.HOLD_LEFT if mode is not FlightMode.HOLD and not held else None
        if self.state not in (State.REGAINING, State.REJOINED):
            return None
        if mode in view.modes:
            return Event.SHOWN
        return None if now_ns - self.since_ns < REGAIN_NS else Event.TIME_UP

    def _is_foreign(self, view: View) -> bool:
        """Whether a pilot, a ground station or a failsafe has chosen the autopilot's mode. Before arming, any mode is fine."""
        vehicle, stage = view.vehicle, view.flight.stage
        if not vehicle.armed or vehicle.mode is FlightMode.MANUAL:
            return vehicle.armed
        if self.state in (State.REGAINING, State.REJOINED):
            return False
        if view.flight.position_loss.stays and (vehicle.mode is FlightMode.HOLD or not vehicle.healthy):  # for want of a position
            return False
        if vehicle.mode is not FlightMode.HOLD:
            return vehicle.mode in (FlightMode.RETURN, FlightMode.LAND) and vehicle.mode not in MODES[stage]
        if self.state is not State.AGENT:
            return False
        return (
            view.flight.is_steered or stage is Stage.TAKEOFF or (stage in DESCENDING and vehicle.healthy)
        )  # a failsafe holds for a while


def _patience_ns(view: View) -> int:
    """Return how long a mode that the agent has not asked for must last to be a takeover."""
    vehicle = view.vehicle
    if vehicle.mode is FlightMode.HOLD and view.flight.stage in DESCENDING:
        return TOUCHDOWN_NS
    return TAKEOVER_NS if vehicle.healthy or vehicle.mode is FlightMode.MANUAL else FAILSAFE_NS
