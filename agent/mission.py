"""The stages of a mission, for one drone: what it is doing, and what makes it do something else."""

from __future__ import annotations

from msgspec import Struct

from agent.config import TrackConfig
from agent.vehicle.interface import FlightMode, Request, VehicleState
from protocol.messages import Action, Stage

SEARCHING = (Stage.SURVEY, Stage.TRACK, Stage.REACQUIRE)
STEERED = (*SEARCHING, Stage.RETURN)  # the stages that fly by setpoints, keeping clear of each other
FLYING = (*STEERED, Stage.TAKEOFF, Stage.HOLD, Stage.LANDING, Stage.ABORT)
TAKEOVER_NS = 1_500_000_000  # a heartbeat is up to 1 s old: wait longer before believing that somebody took over

_REQUESTS = {
    Stage.PREFLIGHT: Request.STAY,
    Stage.LANDED: Request.STAY,
    Stage.TAKEOFF: Request.TAKEOFF,
    Stage.SURVEY: Request.OFFBOARD,
    Stage.TRACK: Request.OFFBOARD,
    Stage.REACQUIRE: Request.OFFBOARD,
    Stage.HOLD: Request.HOLD,
    Stage.RETURN: Request.OFFBOARD,
    Stage.LANDING: Request.LAND,
    Stage.ABORT: Request.LAND,
}


class Situation(Struct, frozen=True):
    """What a decision rests on. ``last_cone_ns``: newest cone in the log, of whomever; 0 where there is none.

    ``at_home``: the drone hovers over the place where it took off. ``problems``: what stands against a start.
    """

    now_ns: int
    vehicle: VehicleState | None
    has_hypothesis: bool
    last_cone_ns: int
    at_home: bool
    problems: tuple[str, ...] = ()


class Mission:
    """The stage of one drone and its history."""

    def __init__(self, track: TrackConfig, can_lose: bool = True) -> None:
        """``can_lose``: the hypothesis rests on cones, and is doubted when they stay away."""
        self.stage = Stage.PREFLIGHT
        self.started_ns: int | None = None
        self.since_ns = 0  # when the present stage began
        self.tracking_since_ns: int | None = None
        self._track = track
        self._timeout_s = track.no_cone_timeout_s if can_lose else None
        self._resume = Stage.SURVEY
        self._foreign_since_ns: int | None = None
        self._released = False

    @property
    def request(self) -> Request:
        """What this stage wants of the autopilot."""
        return Request.RELEASE if self._released else _REQUESTS[self.stage]

    def command(self, action: Action, stamp_ns: int, situation: Situation) -> str | None:
        """Carry out an operator's command. Returns why it was refused, or None."""
        if action is Action.START:
            if self.stage is not Stage.PREFLIGHT:
                return "start: already started"
            if situation.problems:
                return f"start refused: {situation.problems[0]}"
            self.started_ns = stamp_ns
            self._enter(Stage.TAKEOFF, situation.now_ns)
            return None
        if self.stage not in FLYING:
            return f"{action}: not flying"
        if self.stage is Stage.ABORT:
            return f"{action}: aborted"
        if action is Action.RESUME:
            if self.stage is not Stage.HOLD:
                return "resume: not holding"
            self._released = False
            self._enter(self._resume, situation.now_ns)
        elif action is Action.HOLD:
            if self.stage not in SEARCHING:
                return f"hold: not possible in {self.stage}"
            self._hold(situation.now_ns)
        else:
            stage = {Action.RETURN: Stage.RETURN, Action.LAND: Stage.LANDING, Action.ABORT: Stage.ABORT}[action]
            self._released = False
            self._enter(stage, situation.now_ns)
        return None

    def step(self, situation: Situation) -> None:
        """Move on to the next stage where the situation says so."""
        vehicle, now_ns = situation.vehicle, situation.now_ns
        if vehicle is None or self.stage in (Stage.PREFLIGHT, Stage.LANDED):
            return
        if self.stage is Stage.TAKEOFF:
            if vehicle.in_air and vehicle.mode is FlightMode.HOLD:
                self._enter(Stage.TRACK if situation.has_hypothesis else Stage.SURVEY, now_ns)
        elif self.stage in STEERED and not self._released:
            self._watch_takeover(vehicle, now_ns)
            if self.stage is Stage.RETURN and situation.at_home:
                self._enter(Stage.LANDING, now_ns)
            elif self.stage in SEARCHING:
                self._search(situation)
        elif not vehicle.armed and not vehicle.in_air:
            self._enter(Stage.LANDED, now_ns)

    def _search(self, situation: Situation) -> None:
        now_ns = situation.now_ns
        if self.stage is Stage.SURVEY:
            if situation.has_hypothesis:
                self._enter(Stage.TRACK, now_ns)
            return
        if not situation.has_hypothesis:  # a late entry can take the hypothesis back
            self._enter(Stage.SURVEY, now_ns)
            return
        assert self.tracking_since_ns is not None
        duration_s, timeout_s = self._track.duration_s, self._timeout_s
        if duration_s is not None and now_ns - self.tracking_since_ns > duration_s * 1e9:
            self._enter(Stage.RETURN, now_ns)
        elif timeout_s is not None:
            lost = now_ns - max(situation.last_cone_ns, self.tracking_since_ns) > timeout_s * 1e9
            stage = Stage.REACQUIRE if lost else Stage.TRACK
            if stage is not self.stage:
                self._enter(stage, now_ns)

    def _watch_takeover(self, vehicle: VehicleState, now_ns: int) -> None:
        """Give way when the autopilot stays in a mode that was not asked for: its failsafe, or a human pilot."""
        if vehicle.mode not in (FlightMode.RETURN, FlightMode.LAND, FlightMode.MANUAL):
            self._foreign_since_ns = None
            return
        if self._foreign_since_ns is None:
            self._foreign_since_ns = now_ns
        if now_ns - self._foreign_since_ns > TAKEOVER_NS:
            if vehicle.mode is FlightMode.MANUAL:
                self._hold(now_ns)
            else:
                self._enter(Stage.RETURN if vehicle.mode is FlightMode.RETURN else Stage.LANDING, now_ns)
            self._released = True

    def _hold(self, now_ns: int) -> None:
        self._resume = self.stage
        self._enter(Stage.HOLD, now_ns)

    def _enter(self, stage: Stage, now_ns: int) -> None:
        self.stage, self.since_ns = stage, now_ns
        self._foreign_since_ns = None
        if stage is Stage.TRACK and self.tracking_since_ns is None:
            self.tracking_since_ns = now_ns
