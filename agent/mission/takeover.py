"""Whether somebody else flies the vehicle: a human pilot or the autopilot's failsafe, judged by the autopilot's mode."""

from __future__ import annotations

from agent.vehicle.grounded import STILL_NS
from agent.vehicle.interface import FlightMode, Request, VehicleState
from protocol.messages import Stage

SEARCHING = (Stage.SURVEY, Stage.TRACK, Stage.REACQUIRE)
STEERED = (*SEARCHING, Stage.RETURN)  # the stages flown by setpoints, with separation
COMING_DOWN = (Stage.LANDING, Stage.ABORT)
FLYING = (*STEERED, Stage.TAKEOFF, Stage.HOLD, Stage.LANDING, Stage.ABORT)
TAKEOVER_NS = 1_500_000_000  # a heartbeat is up to 1 s old: wait longer before taking a mode for a takeover
FAILSAFE_NS = 3_000_000_000  # the same for a failsafe, which may pass
# The same for a hold in a landing: after touchdown the autopilot shows one until it is believed that the vehicle is down.
TOUCHDOWN_NS = STILL_NS + TAKEOVER_NS
REJOIN_NS = 5_000_000_000  # this agent has so long to get the vehicle out of a failsafe, or of a hold
STALE_NS = 1_200_000_000  # greatest age of the mode in a heartbeat
# An autopilot ends its takeoff by itself this far below its height at most: 0.5 to 1.0 m in 20 recorded takeoffs (NAV_MC_ALT_RAD
# is 0.8 m). Nothing else tells its hold from a pilot's: mode, intended mode, landed state and events are the same.
CUT_SHORT_M = 1.5
OWN_HOLD_NS = 3_000_000_000  # a hold that this agent has asked for is shown within this time

MODES: dict[Stage, tuple[FlightMode, ...]] = {  # the autopilot's, that belong to a stage
    Stage.TAKEOFF: (FlightMode.TAKEOFF, FlightMode.HOLD, FlightMode.OFFBOARD),  # the last metres by setpoints
    Stage.HOLD: (FlightMode.HOLD,),
    Stage.LANDING: (FlightMode.LAND,),
    Stage.ABORT: (FlightMode.LAND,),
    **dict.fromkeys(STEERED, (FlightMode.OFFBOARD,)),
}

REQUESTS: dict[Stage, Request] = {  # what a stage asks of the autopilot
    Stage.PREFLIGHT: Request.STAY,
    Stage.LANDED: Request.STAY,
    Stage.TAKEOFF: Request.TAKEOFF,
    Stage.HOLD: Request.HOLD,
    Stage.LANDING: Request.LAND,
    Stage.ABORT: Request.LAND,
    **dict.fromkeys(STEERED, Request.OFFBOARD),
}

_SHOWN_AS = {Request.OFFBOARD: FlightMode.OFFBOARD, Request.HOLD: FlightMode.HOLD, Request.LAND: FlightMode.LAND}
_BY_MODE = {  # of a vehicle that somebody else flies
    FlightMode.RETURN: Stage.RETURN,
    FlightMode.LAND: Stage.LANDING,
    FlightMode.HOLD: Stage.HOLD,
    FlightMode.MANUAL: Stage.HOLD,
}


def is_failsafe(vehicle: VehicleState) -> bool:
    """Whether the autopilot brings the vehicle home or down, and nobody has asked it to."""
    return vehicle.mode in (FlightMode.RETURN, FlightMode.LAND) and not vehicle.healthy


def is_elsewhere(vehicle: VehicleState | None, request: Request) -> bool:
    """Whether somebody has the autopilot in another mode than requested; a human pilot at the sticks keeps the vehicle."""
    if vehicle is None or not vehicle.healthy or vehicle.mode is FlightMode.MANUAL:
        return False
    return vehicle.mode is not _SHOWN_AS.get(request, vehicle.mode)


def is_cut_short(vehicle: VehicleState, height_m: float) -> bool:
    """Whether a takeoff to a height above the launch place has ended long before: somebody has chosen another mode."""
    return vehicle.in_air and vehicle.position_trusted and vehicle.position_m[2] < height_m - CUT_SHORT_M


class Takeover:
    """Notices a mode that this agent has not asked for and that stays.

    A time of the future is from before the clock was set back, and counts no more.
    """

    def __init__(self) -> None:
        self._foreign_since_ns: int | None = None
        self._was_reached = False  # the mode of the stage: only then is a hold somebody's
        self._rejoining_until_ns = 0
        self._held_ns: int | None = None  # when this agent itself last asked for a hold, for want of telemetry
        self._holds = False  # the autopilot has been in that hold ever since: on a bad link it takes long to leave it

    def hold_asked(self, now_ns: int) -> None:
        """This agent asks the autopilot to hold for now: that is not somebody's takeover."""
        self._held_ns = now_ns

    def changed(self) -> None:
        """The request to the autopilot has changed to or from offboard, or is made again."""
        self._was_reached, self._foreign_since_ns, self._holds = False, None, False

    def left_hold(self, now_ns: int) -> None:
        """The position can be trusted again: the vehicle is on its way back from hold to offboard."""
        self._was_reached, self._rejoining_until_ns = False, now_ns + REJOIN_NS

    def holds(self, now_ns: int) -> bool:
        """Whether a hold that the autopilot shows is this agent's own: it has asked for one, or offboard has not been reached
        since.
        """
        return not self._was_reached or self._asked_to_hold(now_ns)

    def rejoin(self, vehicle: VehicleState, stage: Stage, now_ns: int, *, holds: bool) -> bool:
        """Continue a flight in which this agent was restarted; returns whether somebody else flies.

        Without setpoints the autopilot returns or lands in its failsafe (``healthy`` is False then), and goes back to offboard
        when they resume. In a hold it stays. ``holds``: as it was when the agent was ended.
        """
        self._was_reached = stage is not Stage.TAKEOFF and not (holds and vehicle.mode is FlightMode.HOLD)
        foreign = self._is_foreign(vehicle, stage, stage in STEERED)
        if vehicle.mode is FlightMode.MANUAL or (vehicle.healthy and foreign):  # no failsafe led to it
            return True
        if stage in STEERED or (stage is Stage.TAKEOFF and is_failsafe(vehicle)):
            self._rejoining_until_ns = now_ns + REJOIN_NS
        return False

    def step(
        self,
        vehicle: VehicleState,
        stage: Stage,
        since_ns: int,
        now_ns: int,
        *,
        steered: bool,
        stays: bool,
        cut_short: bool = False,
    ) -> bool:
        """Whether the autopilot has stayed in a mode that was not requested in this stage, which began at ``since_ns``.

        A failsafe is given time to pass: after a gap in the setpoints the autopilot goes back to offboard by itself.
        ``steered``: it is flown by setpoints; ``stays``: it holds because its position cannot be trusted; ``cut_short``: its
        takeoff has ended long before its height.
        """
        settled = not 0 <= now_ns - since_ns <= STALE_NS and not stays
        own = FlightMode.LAND if stage in COMING_DOWN else FlightMode.OFFBOARD
        self._was_reached = self._was_reached or (settled and vehicle.mode is own) or cut_short
        if vehicle.mode in ((FlightMode.OFFBOARD,) if steered else MODES[stage]):
            self._rejoining_until_ns = 0
        if self._is_own(vehicle, now_ns, stays) or not self._is_foreign(vehicle, stage, steered):
            self._foreign_since_ns = None
            return False
        if self._foreign_since_ns is None or self._foreign_since_ns > now_ns:
            self._foreign_since_ns = now_ns
        patience_ns = TAKEOVER_NS if vehicle.healthy or vehicle.mode is FlightMode.MANUAL else FAILSAFE_NS
        if vehicle.mode is FlightMode.HOLD and stage in COMING_DOWN:
            patience_ns = TOUCHDOWN_NS
        return now_ns - self._foreign_since_ns > patience_ns

    def _is_own(self, vehicle: VehicleState, now_ns: int, stays: bool) -> bool:
        """Whether the mode follows from what this agent does: holds, or leaves a hold or a failsafe."""
        self._holds = self._asked_to_hold(now_ns) and vehicle.mode is FlightMode.HOLD
        if vehicle.mode is FlightMode.MANUAL:
            return False
        holds = self._holds or (stays and vehicle.mode is FlightMode.HOLD)
        fails = stays and not vehicle.healthy  # for want of a position
        return holds or fails or 0 < self._rejoining_until_ns - now_ns <= REJOIN_NS

    def _asked_to_hold(self, now_ns: int) -> bool:
        return self._holds or (self._held_ns is not None and 0 <= now_ns - self._held_ns < OWN_HOLD_NS)

    def _is_foreign(self, vehicle: VehicleState, stage: Stage, steered: bool) -> bool:
        """Whether somebody other than this agent has chosen the mode. Before arming, any mode is fine."""
        mode = vehicle.mode
        if not vehicle.armed:
            return False
        if mode is not FlightMode.HOLD:
            return mode in (FlightMode.MANUAL, FlightMode.RETURN, FlightMode.LAND) and mode not in MODES[stage]
        if not self._was_reached:
            return False  # not yet in the mode of the stage
        return steered or stage is Stage.TAKEOFF or (stage in COMING_DOWN and vehicle.healthy)  # a failsafe holds for a while


class ForeignStage:
    """The stage of a vehicle that somebody else flies, by the mode that the autopilot has been in for a while: a failsafe for
    want of battery holds before it goes home, and a human pilot may cancel it. The others reckon with what its last stage tells.
    """

    def __init__(self) -> None:
        self._mode: FlightMode | None = None
        self._since_ns = 0

    def stage(self, stage: Stage, mode: FlightMode, now_ns: int) -> Stage:
        """The stage that follows on ``stage``."""
        if mode is not self._mode or self._since_ns > now_ns:  # or the clock was set back
            self._mode, self._since_ns = mode, now_ns
        if now_ns - self._since_ns < FAILSAFE_NS:
            return stage
        return _BY_MODE.get(mode, stage)
