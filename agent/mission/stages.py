"""The stages of a mission for one drone, and who flies it: takeover and failsafe are judged here, by the autopilot's mode."""

from __future__ import annotations

from msgspec import Struct

from agent.config.mission import SurveyConfig, TrackConfig
from agent.geometry import Vector3
from agent.mission.memory import REFRESH_NS, Memory
from agent.mission.positionloss import PositionLoss
from agent.vehicle.interface import FlightMode, Request, VehicleState
from protocol.messages import Action, Stage

SEARCHING = (Stage.SURVEY, Stage.TRACK, Stage.REACQUIRE)
STEERED = (*SEARCHING, Stage.RETURN)  # the stages flown by setpoints, with separation
FLYING = (*STEERED, Stage.TAKEOFF, Stage.HOLD, Stage.LANDING, Stage.ABORT)
TAKEOVER_NS = 1_500_000_000  # a heartbeat is up to 1 s old: wait longer before taking a mode for a takeover
_FOUND_AGAIN = 0.7  # of the RMS at which the source counts as lost: hysteresis
FAILSAFE_NS = 3_000_000_000  # the same for a failsafe, which may pass
REJOIN_NS = 5_000_000_000  # a restarted agent has this long to get the vehicle out of its failsafe
STALE_NS = 1_200_000_000  # greatest age of the mode in a heartbeat
OWN_HOLD_NS = 3_000_000_000  # a hold that this agent has asked for is shown and left again within this time
STRANDED_NS = 5_000_000_000  # a drone that is to return because it does not hear others, or is in doubt, waits this long
NO_NEARER = "it did not get home: its place is not known, or something kept it away"
UNSTEERED_NS = 3_000_000_000  # after this long without offboard in a steered stage it is reported

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
_STAGE_AFTER = {
    Action.START: Stage.TAKEOFF,
    Action.RETURN: Stage.RETURN,
    Action.LAND: Stage.LANDING,
    Action.ABORT: Stage.ABORT,
}
# The autopilot's modes that belong to a stage.
_MODES: dict[Stage, tuple[FlightMode, ...]] = {
    Stage.TAKEOFF: (FlightMode.TAKEOFF, FlightMode.HOLD),
    Stage.HOLD: (FlightMode.HOLD,),
    Stage.LANDING: (FlightMode.LAND,),
    Stage.ABORT: (FlightMode.LAND,),
    **dict.fromkeys(STEERED, (FlightMode.OFFBOARD,)),
}


class Situation(Struct, frozen=True):
    """The inputs of a decision. ``last_cone_ns``: stamp of the newest cone in the log, of any drone; 0 where there is none.

    ``at_home``: the drone hovers over the place where it took off. ``problems``: those that prevent a start. ``rms_m``: of the
    source estimate, by an estimator with a posterior; else None. ``nothing_found``: the search has ended without a source.
    ``stranded``: other drones are not heard, and the mission, or the fence, leaves this one nothing but to return; or it may be
    far from where it believes to be.
    ``battery_low``: it is this drone's turn to return for want of battery. ``no_nearer``: its return has not got on for long.
    """

    now_ns: int
    vehicle: VehicleState | None
    has_hypothesis: bool
    last_cone_ns: int
    at_home: bool
    problems: tuple[str, ...] = ()
    rms_m: float | None = None
    nothing_found: bool = False
    stranded: bool = False
    battery_low: bool = False
    no_nearer: bool = False


class Mission:
    """The stage of one drone, and what its transitions depend on."""

    def __init__(self, track: TrackConfig, survey: SurveyConfig | None = None, can_lose: bool = True) -> None:
        """``can_lose``: the hypothesis rests on measurements, and counts as lost when they stay away."""
        self.stage = Stage.PREFLIGHT
        self.since_ns = 0  # when the present stage began
        self.started_ns = 0  # stamp of the start command with which the swarm's mission began
        self.tracking_since_ns: int | None = None
        self._track = track
        self._gives_up = survey is not None and survey.then == "return"
        self._can_lose = can_lose
        self.resume = Stage.SURVEY  # the stage after a hold
        self.released = False  # somebody else has taken over
        self._foreign_since_ns: int | None = None
        self._unsteered_since_ns: int | None = None
        self._position_loss = PositionLoss()
        self.landed_because = ""  # why it landed, unless on request or by a human pilot
        self._rejoining_until_ns = 0
        self._search_since_ns: int | None = None
        self._stranded_since_ns: int | None = None
        self._was_armed = self._was_offboard = False
        self._mode = FlightMode.HOLD
        self._held_ns: int | None = None  # when this agent itself last asked for a hold, for want of telemetry

    @property
    def request(self) -> Request:
        """The request of this stage to the autopilot; hold while the position cannot be trusted."""
        if self.released:
            return Request.RELEASE
        if self._position_loss.stays and self.stage in (Stage.TAKEOFF, *STEERED):
            return Request.HOLD
        return _REQUESTS[self.stage]

    def command(self, action: Action, stamp_ns: int, situation: Situation, started_ns: int | None = None) -> str | None:
        """Carry out an operator's command of that stamp. Returns why it was refused, or None.

        ``started_ns``: stamp of the start with which the swarm's mission began; None: this one.
        """
        refused = self._refusal(action, situation)
        if refused is not None:
            return refused
        self.released, self._unsteered_since_ns = False, None
        if action is Action.START:
            self._begin_anew()
            self.started_ns = stamp_ns if started_ns is None else started_ns
        if action is Action.HOLD:
            self._hold(situation.now_ns)
            return None
        stage = self.resume if action is Action.RESUME else _STAGE_AFTER[action]
        self._enter(stage, situation.now_ns)
        return None

    def _refusal(self, action: Action, situation: Situation) -> str | None:
        if action is Action.START:
            if self.stage not in (Stage.PREFLIGHT, Stage.LANDED):
                return "start: already started"
            return f"start refused: {situation.problems[0]}" if situation.problems else None
        if self.stage not in FLYING:
            return f"{action}: not flying"
        if self.stage is Stage.ABORT:
            return f"{action}: aborted"
        if action is Action.RESUME and self.stage is not Stage.HOLD:
            return "resume: not holding"
        if action is Action.HOLD and self.stage not in (Stage.TAKEOFF, *STEERED):
            return f"hold: not possible in {self.stage}"
        return None

    def _begin_anew(self) -> None:
        """Forget the flight before this one."""
        self.tracking_since_ns = self._search_since_ns = None
        self.resume, self.landed_because = Stage.SURVEY, ""
        self._was_armed = False
        self._position_loss = PositionLoss()

    def unsteered(self, now_ns: int) -> str | None:
        """What is reported of a vehicle that does not follow this agent; None while it does."""
        since_ns = self._unsteered_since_ns
        if since_ns is None or now_ns - since_ns < UNSTEERED_NS or self.stage not in FLYING:
            return None
        lasts = f"for {(now_ns - since_ns) * 1e-9:.0f} s"
        if self.released:
            return f"under the control of a human pilot or of its failsafe: the autopilot has been in {self._mode} {lasts}"
        return f"not following its mission: the autopilot has been in {self._mode}, not in offboard, {lasts}"

    def searched_s(self, now_ns: int) -> float:
        """Duration of the present search, including holds; 0 before it."""
        return (now_ns - self._search_since_ns) * 1e-9 if self._search_since_ns is not None else 0.0

    def memory(self, mission_id: str, home_m: Vector3 | None, now_ns: int, epoch_offset: int = 0) -> Memory | None:
        """State for a restarted agent to continue with; None on the ground."""
        if self.stage not in FLYING:
            return None
        return Memory(
            mission=mission_id,
            stamp_ns=now_ns - now_ns % REFRESH_NS,
            started_ns=self.started_ns,
            stage=self.stage,
            resume=self.resume,
            released=self.released,
            tracking_since_ns=self.tracking_since_ns,
            home_m=home_m,
            epoch_offset=epoch_offset,
        )

    def rejoin(self, memory: Memory, vehicle: VehicleState, now_ns: int) -> None:
        """Continue a flight in which this agent was restarted.

        Without setpoints the autopilot returns or lands in its failsafe (``healthy`` is False then), and goes back to offboard
        when they resume. A vehicle that a human pilot controls, has stopped or sent home is left alone.
        """
        self.started_ns = memory.started_ns
        self.tracking_since_ns, self.resume = memory.tracking_since_ns, memory.resume
        self._enter(memory.stage, now_ns)
        self._was_armed = self._was_offboard = True
        chosen = vehicle.healthy and self._is_foreign(vehicle)  # by somebody: no failsafe led to this mode
        if memory.released or chosen or vehicle.mode is FlightMode.MANUAL:
            self._release(vehicle.mode, now_ns)
        elif memory.stage in STEERED:
            self._rejoining_until_ns = now_ns + REJOIN_NS

    def hold_asked(self, now_ns: int) -> None:
        """This agent asks the autopilot to hold for now, without a change of stage: that is not somebody's takeover."""
        self._held_ns = now_ns

    def step(self, situation: Situation) -> None:
        """Enter the next stage where the situation calls for it."""
        vehicle, now_ns = situation.vehicle, situation.now_ns
        if vehicle is None or self.stage not in FLYING:
            return
        self._was_armed = self._was_armed or vehicle.armed
        if self._was_armed and not vehicle.armed and not vehicle.in_air:
            self._enter(Stage.LANDED, now_ns)
            self.released = False  # whoever flew it has disarmed it: from here the agent makes it ready to be armed again
            return
        self._watch_steering(vehicle, now_ns)
        if not self.released:
            self._watch_position(vehicle, now_ns, situation.battery_low)
            self._watch_takeover(vehicle, now_ns)
        if self.released or self._position_loss.stays:
            return
        if self.stage is Stage.TAKEOFF:
            if vehicle.in_air and vehicle.mode in _MODES[Stage.TAKEOFF]:
                self._enter(Stage.TRACK if situation.has_hypothesis else Stage.SURVEY, now_ns)
        elif self.stage is Stage.RETURN:
            if situation.at_home or situation.no_nearer:
                self.landed_because = self.landed_because if situation.at_home else NO_NEARER
                self._enter(Stage.LANDING, now_ns)
        elif self.stage in SEARCHING:
            self._search(situation)

    def _search(self, situation: Situation) -> None:
        now_ns = situation.now_ns
        if situation.battery_low:
            self._enter(Stage.RETURN, now_ns)
            return
        if not situation.stranded:
            self._stranded_since_ns = None
        elif self._stranded_since_ns is None:
            self._stranded_since_ns = now_ns
        elif now_ns - self._stranded_since_ns > STRANDED_NS:
            self._enter(Stage.RETURN, now_ns)
            return
        if self.stage is Stage.SURVEY:
            if situation.has_hypothesis:
                self._enter(Stage.TRACK, now_ns)
            elif situation.nothing_found and self._gives_up:
                self._enter(Stage.RETURN, now_ns)
            return
        if not situation.has_hypothesis:  # a late entry can remove the hypothesis
            self._enter(Stage.SURVEY, now_ns)
            return
        assert self.tracking_since_ns is not None
        duration_s = self._track.duration_s
        if duration_s is not None and now_ns - self.tracking_since_ns > duration_s * 1e9:
            self._enter(Stage.RETURN, now_ns)
            return
        stage = Stage.REACQUIRE if self._is_lost(situation) else Stage.TRACK
        if stage is not self.stage:
            self._enter(stage, now_ns)

    def _is_lost(self, situation: Situation) -> bool:
        """By the posterior's RMS where there is one, otherwise by the time without a cone."""
        if not self._can_lose:
            return False
        if situation.rms_m is not None:
            share = _FOUND_AGAIN if self.stage is Stage.REACQUIRE else 1.0
            return situation.rms_m > share * self._track.lost_rms_m
        timeout_s = self._track.no_cone_timeout_s
        if timeout_s is None or self.tracking_since_ns is None:
            return False
        return situation.now_ns - max(situation.last_cone_ns, self.tracking_since_ns) > timeout_s * 1e9

    def _watch_steering(self, vehicle: VehicleState, now_ns: int) -> None:
        """Note since when somebody else has flown, or the autopilot has not been in offboard where it should be."""
        self._mode = vehicle.mode
        steered = self.stage in STEERED and not self._position_loss.stays
        if not self.released and (not steered or vehicle.mode is FlightMode.OFFBOARD):
            self._unsteered_since_ns = None
        elif self._unsteered_since_ns is None:
            self._unsteered_since_ns = now_ns

    def _watch_position(self, vehicle: VehicleState, now_ns: int, spent: bool) -> None:
        """Hold while the position cannot be trusted, and land where that has brought it near the ground, or lasts too long."""
        stayed = self._position_loss.stays
        self._position_loss.step(vehicle, now_ns, spent=spent)
        if self._position_loss.lands is not None and self.stage in (Stage.TAKEOFF, Stage.HOLD, *STEERED):
            self.landed_because = self._position_loss.lands
            self._enter(Stage.LANDING, now_ns)
        elif stayed and not self._position_loss.stays:
            self._was_offboard, self._rejoining_until_ns = False, now_ns + REJOIN_NS

    def _watch_takeover(self, vehicle: VehicleState, now_ns: int) -> None:
        """Release the vehicle when the autopilot stays in a mode that was not requested: by its failsafe, or a human pilot.

        A failsafe is given time to pass: after a gap in the setpoints the autopilot goes back to offboard by itself.
        """
        settled = now_ns - self.since_ns > STALE_NS and not self._position_loss.stays
        self._was_offboard = self._was_offboard or (settled and vehicle.mode is FlightMode.OFFBOARD)
        if vehicle.mode in _MODES[self.stage]:
            self._rejoining_until_ns = 0
        own = self._position_loss.stays and (not vehicle.healthy or vehicle.mode is FlightMode.HOLD)  # or its failsafe's
        held = self._held_ns is not None and now_ns - self._held_ns < OWN_HOLD_NS
        own = own or (held and vehicle.mode is FlightMode.HOLD)
        rejoining = (own or now_ns < self._rejoining_until_ns) and vehicle.mode is not FlightMode.MANUAL
        if rejoining or not self._is_foreign(vehicle):
            self._foreign_since_ns = None
            return
        if self._foreign_since_ns is None:
            self._foreign_since_ns = now_ns
        patience_ns = TAKEOVER_NS if vehicle.healthy or vehicle.mode is FlightMode.MANUAL else FAILSAFE_NS
        if now_ns - self._foreign_since_ns > patience_ns:
            self._release(vehicle.mode, now_ns)

    def _release(self, mode: FlightMode, now_ns: int) -> None:
        if mode is FlightMode.RETURN:
            self._enter(Stage.RETURN, now_ns)
        elif mode is FlightMode.LAND:
            self._enter(Stage.LANDING, now_ns)
        elif self.stage not in (Stage.HOLD, Stage.LANDING, Stage.ABORT):
            self._hold(now_ns)
        self.released = True

    def _is_foreign(self, vehicle: VehicleState) -> bool:
        """Whether somebody other than this agent has chosen the mode. Before arming, any mode is fine."""
        mode = vehicle.mode
        if not vehicle.armed or mode in _MODES[self.stage]:
            return False
        if mode in (FlightMode.MANUAL, FlightMode.RETURN, FlightMode.LAND):
            return True
        return mode is FlightMode.HOLD and self.stage in STEERED and self._was_offboard  # else: not yet in offboard

    def _hold(self, now_ns: int) -> None:
        self.resume = Stage.SURVEY if self.stage is Stage.TAKEOFF else self.stage
        self._enter(Stage.HOLD, now_ns)

    def _enter(self, stage: Stage, now_ns: int) -> None:
        if stage not in STEERED or self.stage not in STEERED:
            self._was_offboard, self._foreign_since_ns = False, None
        self.stage, self.since_ns = stage, now_ns
        if stage is Stage.TRACK:
            self._search_since_ns = None
        elif stage is Stage.SURVEY and self._search_since_ns is None:
            self._search_since_ns = now_ns
        if stage is Stage.TRACK and self.tracking_since_ns is None:
            self.tracking_since_ns = now_ns
