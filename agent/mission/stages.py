"""The stages of a mission for one drone."""

from __future__ import annotations

from msgspec.structs import replace

from agent.config.mission import SurveyConfig, TrackConfig
from agent.mission.authority import MODES, Authority, Event, View, is_cut_short, is_elsewhere, is_failsafe
from agent.mission.braking import Braking
from agent.mission.floor import is_low
from agent.mission.memory import REFRESH_NS, Memory
from agent.mission.positionloss import NEAR_GROUND_M, PositionLoss
from agent.mission.refusal import STAGE_AFTER, refusal
from agent.mission.searching import Searching
from agent.mission.situation import Situation
from agent.mission.standing import StandingArmed
from agent.navigation.home import KeptHome
from agent.vehicle.interface import FlightMode, Request, VehicleState
from protocol.messages import Action, Stage
from protocol.stages import DESCENDING, FLYING, SEARCHING, STEERED, TAKING_PART

REQUESTS: dict[Stage, Request] = {  # what a stage asks of the autopilot
    Stage.PREFLIGHT: Request.STAY,
    Stage.LANDED: Request.STAY,
    Stage.TAKEOFF: Request.TAKEOFF,
    Stage.HOLD: Request.HOLD,
    **dict.fromkeys(DESCENDING, Request.LAND),
    **dict.fromkeys(STEERED, Request.OFFBOARD),
}
STRANDED_S = 5.0  # a drone that is to return because it does not hear others, or is in doubt, waits this long
# Without room for its circle, no longer: the others keep clear of where its vehicle stops for as long as that would without its
# agent, which has noticed a second later than its autopilot (``navigation.unheard.agentless``).
ROOMLESS_S = 2.0
BROUGHT_DOWN = "its failsafe had brought it near the ground when its agent came back"
SPENT = "its battery did not last for the way home"
NO_NEARER = "it did not get home: its place is not known, or something kept it away"


class Mission:
    """The stage of one drone, and what its transitions depend on."""

    def __init__(
        self, track: TrackConfig, survey: SurveyConfig | None = None, can_lose: bool = True, floor_m: float = 0.0
    ) -> None:
        """``can_lose``: the hypothesis rests on measurements, and counts as lost when they stay away. ``floor_m``: above ground;
        nobody searches below.
        """
        self.stage = Stage.PREFLIGHT
        self.since_ns = 0  # when the present stage began
        self.took_part_ns = 0  # since when it takes part without a break; of no meaning while it does not
        self.started_ns = 0  # stamp of the start command with which the swarm's mission began; 0: not known
        self.tracking_since_ns: int | None = None
        gives_up = survey is not None and survey.then == "return"
        self._searching = Searching(track, gives_up=gives_up, can_lose=can_lose)
        self._floor_m, self._takeoff_m = floor_m, survey.height_m if survey is not None else 0.0
        self._rises = False  # the autopilot's takeoff, or a failsafe, has ended below the floor
        # The stage after a hold, or after it has risen: the last one flown by setpoints, or commanded below the floor.
        self.resume = Stage.SURVEY
        self._aborted = False  # an operator has: until the next start nothing is commanded but to land
        self._asks_again = self._lets_go = False  # the present request, as an operator insists on it: for a step it makes none
        self._authority, self._braking, self._standing = Authority(), Braking(), StandingArmed()
        self._position_loss = PositionLoss()
        self._insists = False  # the operator wants it home although its battery does not seem to last for that
        self.landed_because = ""  # why it landed, unless on request or by a human pilot
        self._search_since_ns: int | None = None
        self._was_armed = False

    @property
    def released(self) -> bool:
        """Whether somebody else flies the vehicle."""
        return self._authority.is_released

    @property
    def request(self) -> Request:
        """The request of this stage to the autopilot; hold while the position cannot be trusted."""
        if self.released or self._lets_go:
            return Request.RELEASE
        if self._standing.disarms:
            return Request.DISARM
        if self._position_loss.stays and self.stage in (Stage.TAKEOFF, *STEERED):
            return Request.HOLD
        if self._is_rising or (self.stage in (Stage.HOLD, Stage.LANDING) and self._braking.lasts):
            return Request.OFFBOARD
        return REQUESTS[self.stage]

    @property
    def _is_rising(self) -> bool:
        """Whether it flies the last metres of its takeoff, or those after a failsafe, by setpoints."""
        return self.stage is Stage.TAKEOFF and self._rises

    @property
    def _is_steered(self) -> bool:
        """Whether it flies by setpoints, unless its position cannot be trusted, or a human pilot flies it."""
        return self.stage in STEERED or self._is_rising

    def command(self, action: Action, stamp_ns: int, situation: Situation, started_ns: int | None = None) -> str | None:
        """Carry out an operator's command of that stamp. Returns why it was refused, or None.

        ``started_ns``: stamp of the start with which the swarm's mission began; None: this one.
        """
        lands, aborted = self._position_loss.lands, self._aborted
        refused = refusal(action, self.stage, situation, lands, aborted=aborted, released=self.released)
        if refused is not None:
            return refused
        before = self.request
        self._authority = self._authority.commanded(situation.now_ns)
        self._obey(action, stamp_ns, situation, started_ns)
        if self.request is before and is_elsewhere(situation.vehicle, self.request):
            self._asks_again = True
            self._authority = self._authority.asks(situation.now_ns)
        return None

    def _obey(self, action: Action, stamp_ns: int, situation: Situation, started_ns: int | None) -> None:
        self._aborted = self._aborted or action is Action.ABORT
        if action is Action.START:
            self._begin_anew()
            self.started_ns = stamp_ns if started_ns is None else started_ns
        if action in (Action.HOLD, Action.LAND):
            self._brake(situation)
        if action in (Action.LAND, Action.ABORT):
            self._standing.ordered()
        if action is Action.HOLD:
            self._enter(Stage.HOLD, situation.now_ns)
            return
        if action is Action.RETURN:
            self._insists = self._insists or self.landed_because == SPENT
        if action in (Action.RETURN, Action.RESUME):
            self.landed_because = ""  # of a landing that it ends
        stage = self.resume if action is Action.RESUME else STAGE_AFTER[action]
        if stage in STEERED and situation.vehicle is not None and is_low(situation.vehicle, self._floor_m):
            self._rise(stage, situation.now_ns)
            return
        self._enter(stage, situation.now_ns)

    def _begin_anew(self) -> None:
        """Forget the flight before this one."""
        self.tracking_since_ns = self._search_since_ns = None
        self.resume, self.landed_because = Stage.SURVEY, ""
        self._was_armed = self._rises = self._insists = self._aborted = False
        self._position_loss = PositionLoss()

    def unsteered(self, now_ns: int) -> str | None:
        """What is reported of a vehicle that does not follow this agent; None while it does."""
        return self._authority.problem(now_ns) if self.stage in FLYING else None

    def standing_armed(self, now_ns: int) -> str | None:
        """What is reported of a vehicle that has landed and is not disarmed."""
        return self._standing.problem(now_ns) if self.stage in DESCENDING else None

    def searched_s(self, now_ns: int) -> float:
        """Duration of the present search, including holds; 0 before it."""
        return (now_ns - self._search_since_ns) * 1e-9 if self._search_since_ns is not None else 0.0

    def memory(self, mission_id: str, home: KeptHome, now_ns: int, epoch_offset: int = 0) -> Memory | None:
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
            aborted=self._aborted,
            stays=self._position_loss.stays,
            holds=self.stage in (*STEERED, *DESCENDING) and self._authority.owns_hold,
            tracking_since_ns=self.tracking_since_ns,
            searching_since_ns=self._search_since_ns,
            home_m=home.place_m,
            home_sigma_m=home.sigma_m,
            launch=home.launch,
            epoch_offset=epoch_offset,
        )

    def find_flying(self, vehicle: VehicleState, now_ns: int) -> None:
        """The vehicle flies, and this agent has not started it, or knows nothing of that any more. Who does so now goes on, a
        human pilot or its failsafe, until an operator commands otherwise. When the swarm's mission began is not known yet.
        """
        self._begin_anew()
        self.started_ns = 0
        self._release(vehicle.mode, now_ns)

    def rejoin(self, memory: Memory, vehicle: VehicleState, now_ns: int) -> None:
        """Continue a flight in which this agent was restarted. A vehicle that somebody else flies is left alone."""
        self.started_ns = memory.started_ns
        self.tracking_since_ns, self._search_since_ns = memory.tracking_since_ns, memory.searching_since_ns
        self._aborted = memory.aborted or memory.stage is Stage.ABORT  # a state file of an older release tells the stage only
        self._enter(memory.stage, now_ns)
        self.resume = memory.stage if memory.stage in STEERED and not memory.released else memory.resume
        self._was_armed = True
        if memory.stays:
            self._position_loss.stay_on(vehicle, now_ns)
        holds = memory.stays or memory.holds
        view = View(vehicle, now_ns, memory.stage, now_ns, memory.stage in STEERED)
        self._authority = self._authority.rejoin(view, holds=holds)
        if self.released or memory.released:
            self._release(vehicle.mode, now_ns)
        elif memory.stage in STEERED or (memory.stage is Stage.TAKEOFF and is_failsafe(vehicle)):
            self._get_clear(vehicle, now_ns)
            self._rises = self.stage is Stage.TAKEOFF  # it continues by setpoints

    def _leave_failsafe(self, vehicle: VehicleState, now_ns: int) -> None:
        """Without setpoints a vehicle returns or lands, and the next setpoint has it fly on from any height. After a time without
        telemetry its mode tells nothing: a heartbeat may be a second old.
        """
        was_blind = self._authority.is_heard_again(vehicle)
        if was_blind:
            self._authority = replace(self._authority, unheard_ns=None)
        if not is_failsafe(vehicle) and not (was_blind and (self.stage is not Stage.RETURN or vehicle.height_m < NEAR_GROUND_M)):
            return
        if self.stage in STEERED or (self._is_rising and vehicle.height_m < NEAR_GROUND_M):
            self._get_clear(vehicle, now_ns)

    def _get_clear(self, vehicle: VehicleState, now_ns: int) -> None:
        """Go on after a failsafe: near the ground, or at home, it lands; below the floor it first rises where it is."""
        low = is_low(vehicle, self._floor_m)
        if vehicle.height_m < NEAR_GROUND_M or (low and self.stage is Stage.RETURN):
            self.landed_because = BROUGHT_DOWN
            self._enter(Stage.LANDING, now_ns)
        elif low:
            self._rise(self.resume if self.stage is Stage.TAKEOFF else self.stage, now_ns)  # restarted as it rose

    def _rise(self, stage: Stage, now_ns: int) -> None:
        """Where it is, by setpoints, to the floor; that stage follows."""
        self._enter(Stage.TAKEOFF, now_ns, rises=True)
        self.resume = stage

    def unheard(self, now_ns: int, *, holds: bool) -> None:
        """There is no recent telemetry. ``holds``: this agent asks the autopilot to hold for now, without a change of stage."""
        self._authority = self._authority.unheard(now_ns, holds=holds)

    def step(self, situation: Situation) -> None:
        """Enter the next stage where the situation calls for it."""
        vehicle, now_ns = situation.vehicle, situation.now_ns
        self._lets_go, self._asks_again = self._asks_again, False
        self.took_part_ns = min(self.took_part_ns, now_ns)  # a later time is from before the clock was set back
        if vehicle is None or self.stage not in FLYING:
            return
        self._was_armed = self._was_armed or vehicle.armed
        self._braking.step(vehicle, now_ns)
        self._standing.step(vehicle, now_ns, comes_down=self.stage in DESCENDING)
        is_to_arm = self.stage is Stage.TAKEOFF and not self._rises and not self._was_armed
        if not (is_to_arm or vehicle.armed or vehicle.in_air):
            self._enter(Stage.LANDED, now_ns)
            # A pilot who flew it has disarmed it: from here the agent makes it ready to be armed again.
            self._authority = self._authority.after(Event.GROUNDED, now_ns)
            return
        is_steered = self._is_steered and not self._position_loss.stays
        self._authority = self._authority.seen(vehicle.mode, now_ns, steered=is_steered)
        if self.released:
            self._position_loss.step(vehicle, now_ns, battery_low=situation.battery_low)  # for the next command
            self._follow_release(now_ns)
            return
        self._watch_position(vehicle, now_ns, situation.battery_low)
        self._watch_battery(situation)
        cut_short = self.stage is Stage.TAKEOFF and not self._rises and is_cut_short(vehicle, self._takeoff_m)
        stays = self._position_loss.stays
        view = View(vehicle, now_ns, self.stage, self.since_ns, self._is_steered, stays, cut_short)
        self._authority = self._authority.judged(view)
        if self.released:
            self._release(vehicle.mode, now_ns)
        if self.released or stays:
            return
        self._leave_failsafe(vehicle, now_ns)
        if self.stage is Stage.TAKEOFF:
            if vehicle.in_air and vehicle.mode in MODES[Stage.TAKEOFF] and not cut_short:
                self._end_takeoff(vehicle, situation)
        elif self.stage is Stage.RETURN:
            if situation.at_home or situation.no_nearer:
                self.landed_because = self.landed_because if situation.at_home else NO_NEARER
                self._enter(Stage.LANDING, now_ns)
        elif self.stage in SEARCHING:
            self._search(situation)
        elif self.stage is Stage.HOLD and situation.must_return:
            self._enter(Stage.RETURN, now_ns)
        self._time_tracking(situation)

    def _end_takeoff(self, vehicle: VehicleState, situation: Situation) -> None:
        if is_low(vehicle, self._floor_m):
            self._rises = True  # the autopilot goes by its own height, and that drifts
            return
        search = Stage.TRACK if situation.is_found else Stage.SURVEY
        self._enter(Stage.RETURN if self.resume is Stage.RETURN else search, situation.now_ns)

    def _time_tracking(self, situation: Situation) -> None:
        """A look at what may move neither ends the search nor begins the tracking."""
        if self.stage is Stage.TRACK and not situation.looks:
            self._search_since_ns = None
            self.tracking_since_ns = situation.now_ns if self.tracking_since_ns is None else self.tracking_since_ns

    def _search(self, situation: Situation) -> None:
        stage = self._searching.next(self.stage, situation, self.tracking_since_ns)
        if stage is not self.stage:
            self._enter(stage, situation.now_ns)

    def _watch_battery(self, situation: Situation) -> None:
        """Land where it is rather than run empty on the way: the autopilot would hold, climb and land from high up."""
        if situation.battery_spent and self.stage in (Stage.HOLD, *STEERED) and not self._insists:
            self.landed_because = SPENT
            self._brake(situation)
            self._enter(Stage.LANDING, situation.now_ns)

    def _brake(self, situation: Situation) -> None:
        """From a stage flown by setpoints: first by these to rest."""
        if self.stage in STEERED and situation.vehicle is not None:
            self._braking.begin(situation.vehicle, situation.now_ns)

    def _watch_position(self, vehicle: VehicleState, now_ns: int, battery_low: bool) -> None:
        """Hold while the position cannot be trusted, and land where that has brought it near the ground, or lasts too long."""
        stayed = self._position_loss.stays
        self._position_loss.step(vehicle, now_ns, battery_low=battery_low)
        if self._position_loss.lands is not None and self.stage in (Stage.TAKEOFF, Stage.HOLD, *STEERED):
            self.landed_because = self._position_loss.lands
            self._enter(Stage.LANDING, now_ns)
        elif stayed and not self._position_loss.stays:
            self._authority = self._authority.after(Event.REGAINS, now_ns)
            if self.stage in STEERED:
                self._get_clear(vehicle, now_ns)

    def _release(self, mode: FlightMode, now_ns: int) -> None:
        self._authority = self._authority.after(Event.OVERRULED, now_ns)
        if mode is FlightMode.RETURN:
            self._enter(Stage.RETURN, now_ns)
        elif mode is FlightMode.LAND:
            self._enter(Stage.LANDING, now_ns)
        elif self.stage is not Stage.HOLD and (mode is FlightMode.HOLD or self.stage not in DESCENDING):
            self._enter(Stage.HOLD, now_ns)

    def _follow_release(self, now_ns: int) -> None:
        flown = self._authority.flown_as(self.stage, now_ns)
        if flown is not self.stage:
            self._enter(flown, now_ns)

    def _enter(self, stage: Stage, now_ns: int, *, rises: bool = False) -> None:
        if self.stage not in TAKING_PART:
            self.took_part_ns = now_ns
        was_steered = self._is_steered
        self.stage, self.since_ns, self._rises = stage, now_ns, rises
        if not (was_steered and self._is_steered):
            self._authority = self._authority.asks(now_ns)
        if stage in STEERED and not self.released:
            self.resume = stage
        if stage is Stage.SURVEY and self._search_since_ns is None:
            self._search_since_ns = now_ns
