"""The stages of a mission for one drone: from commands, telemetry and time to the events of the table (``transitions.py``)."""

from __future__ import annotations

from math import inf

from msgspec.structs import replace

from radron.agent.config.mission import TrackConfig
from radron.agent.config.survey import SurveyConfig
from radron.agent.lasting import since
from radron.agent.mission.authority import MODES, Authority, View, is_cut_short, is_elsewhere, is_failsafe
from radron.agent.mission.authority import Event as Handover
from radron.agent.mission.flight import Flight
from radron.agent.mission.memory import REFRESH_NS, Memory
from radron.agent.mission.positionloss import NEAR_GROUND_M
from radron.agent.mission.refusal import refusal
from radron.agent.mission.searching import Searching
from radron.agent.mission.situation import Situation
from radron.agent.mission.transitions import REQUESTS, TABLE, Event
from radron.agent.navigation.home import KeptHome
from radron.agent.vehicle.interface import FlightMode, Request, VehicleState
from radron.protocol.messages import Action, Stage
from radron.protocol.stages import BRAKING, DESCENDING, FLYING, SEARCHING, STEERED
from radron.protocol.texts import CodedText

STRANDED_S = 5.0  # return delay after lost links, or with an uncertain position
# Return delay without a feasible circle. The others keep the stopping place clear for as long as the vehicle would stop there
# after the loss of its agent. The agent notices that a second later than its autopilot (``navigation.unheard.agentless``).
ROOMLESS_S = 2.0
_STOPS_S = 0.5  # stopping distance of a sinking vehicle, as the time at its speed: its lag, and braking at 2 m/s^2
_ABOVE_FLOOR_M = 0.25  # margin above the floor: heights err by 0.05 m (1 sigma), and references are 0.5 m above it
_FLOWN = {  # by a pilot, a ground station or a failsafe
    FlightMode.RETURN: Event.FLOWN_HOME,
    FlightMode.LAND: Event.FLOWN_DOWN,
    FlightMode.HOLD: Event.FLOWN_HELD,
}
_FLOWN_ON = {**_FLOWN, FlightMode.MANUAL: Event.FLOWN_HELD}  # the same once the mode has lasted


class Mission:
    """The mission of one drone. ``flight``: the present one, or the last."""

    def __init__(
        self, track: TrackConfig, survey: SurveyConfig | None = None, can_lose: bool = True, floor_m: float = 0.0
    ) -> None:
        """``can_lose``: the hypothesis rests on measurements, and counts as lost when they stay away. ``floor_m``: above ground;
        no search below.
        """
        self._searching = Searching(track, gives_up=survey is not None and survey.then == "return", can_lose=can_lose)
        self._floor_m, self._takeoff_m = floor_m, survey.height_m if survey is not None else 0.0
        self.flight, self._authority = Flight(), Authority()
        self._asks_again = self._lets_go = False  # the present request, as an operator insists on it: for a step it makes none

    @property
    def stage(self) -> Stage:
        """The present stage."""
        return self.flight.stage

    @property
    def released(self) -> bool:
        """Whether a pilot, a ground station or a failsafe flies the vehicle."""
        return self._authority.is_released

    @property
    def request(self) -> Request:
        """The request of this stage to the autopilot; hold while the position cannot be trusted."""
        flight = self.flight
        if self.released or self._lets_go:
            return Request.RELEASE
        if flight.standing.disarms:
            return Request.DISARM
        if flight.position_loss.stays and flight.stage in (Stage.TAKEOFF, *STEERED):
            return Request.HOLD
        brakes = flight.stage in BRAKING and flight.braking.begun_ns is not None
        return Request.OFFBOARD if flight.is_rising or brakes else REQUESTS[flight.stage]

    def command(self, action: Action, started_ns: int, situation: Situation) -> str | None:
        """Carry out an operator's command. Returns the reason of a refusal, or None.

        ``started_ns``: of a start, stamp of the start with which the swarm's mission began.
        """
        refused = refusal(action, self.flight, situation, released=self.released)
        if refused is not None:
            return refused
        before = self.request
        self._authority = self._authority.commanded(situation.now_ns)
        self._obey(action, started_ns, situation)
        if self.request is before and is_elsewhere(situation.vehicle, self.request):
            self._asks_again = True
            self._authority = self._authority.asks(situation.now_ns)
        return None

    def _obey(self, action: Action, started_ns: int, situation: Situation) -> None:
        flight = Flight(started_ns=started_ns) if action is Action.START else self.flight
        flies_on = action in (Action.RETURN, Action.RESUME)
        self.flight = replace(
            flight,
            aborted=flight.aborted or action is Action.ABORT,
            insists=flight.insists or (action is Action.RETURN and flight.landed_because == Event.SPENT),
            landed_because="" if flies_on else flight.landed_because,  # of a landing that it ends
            standing=flight.standing.ordered() if action in (Action.LAND, Action.ABORT) else flight.standing,
            resume=Stage.RETURN if action is Action.RETURN else flight.resume,
        )
        low = flies_on and situation.vehicle is not None and self._is_low(situation.vehicle)
        self._apply(Event.LOW if low else action, situation.now_ns, situation.vehicle)

    def begin(self, started_ns: int) -> None:
        """Take over the stamp of the start command with which the swarm's mission began."""
        self.flight = replace(self.flight, started_ns=started_ns)

    def unsteered(self, now_ns: int) -> CodedText | None:
        """Return the problem of a vehicle that does not follow this agent; None while it does."""
        return self._authority.problem(now_ns) if self.stage in FLYING else None

    def standing_armed(self, now_ns: int) -> CodedText | None:
        """Return the problem of a vehicle that has landed and is not disarmed."""
        return self.flight.standing.problem(now_ns) if self.stage in DESCENDING else None

    def memory(self, mission_id: str, home: KeptHome, now_ns: int, epoch_offset: int = 0) -> Memory | None:
        """State for a restarted agent to continue with; None on the ground."""
        flight = self.flight
        if flight.stage not in FLYING:
            return None
        return Memory(
            mission=mission_id,
            stamp_ns=now_ns - now_ns % REFRESH_NS,
            started_ns=flight.started_ns,
            stage=flight.stage,
            resume=flight.resume,
            released=self.released,
            aborted=flight.aborted,
            stays=flight.position_loss.stays,
            holds=flight.stage in (*STEERED, *DESCENDING) and self._authority.owns_hold,
            tracking_since_ns=flight.tracking_since_ns,
            searching_since_ns=flight.searching_since_ns,
            home_m=home.place_m,
            home_sigma_m=home.sigma_m,
            launch=home.launch,
            epoch_offset=epoch_offset,
        )

    def find_flying(self, vehicle: VehicleState, now_ns: int) -> None:
        """Begin with the vehicle in flight: not started by this agent, or its state is lost. The pilot or the failsafe keeps the
        vehicle until an operator commands otherwise. The begin of the swarm's mission is not known yet.
        """
        self.flight = Flight()
        self._release(vehicle.mode, now_ns)

    def rejoin(self, memory: Memory, vehicle: VehicleState, now_ns: int) -> None:
        """Continue a flight in which this agent was restarted. A vehicle flown by a pilot, a ground station or a failsafe is left
        alone.
        """
        self.flight = Flight.restored(memory, vehicle, now_ns)
        self._authority = Authority().rejoin(View(vehicle, now_ns, self.flight), holds=memory.stays or memory.holds)
        if self.released or memory.released:
            self._release(vehicle.mode, now_ns)
        elif self.stage in STEERED or (self.stage is Stage.TAKEOFF and is_failsafe(vehicle)):
            self._get_clear(vehicle, now_ns)
            self.flight = replace(self.flight, rises=self.stage is Stage.TAKEOFF)  # continues by setpoints

    def _leave_failsafe(self, vehicle: VehicleState, now_ns: int) -> None:
        """Without setpoints a vehicle returns or lands, and the next setpoint has it fly on from any height. After a time without
        telemetry its mode means nothing: a heartbeat may be a second old.
        """
        was_blind = self._authority.is_heard_again(vehicle)
        if was_blind:
            self._authority = replace(self._authority, unheard_ns=None)
        if not is_failsafe(vehicle) and not (was_blind and (self.stage is not Stage.RETURN or vehicle.height_m < NEAR_GROUND_M)):
            return
        if self.stage in STEERED or (self.flight.is_rising and vehicle.height_m < NEAR_GROUND_M):
            self._get_clear(vehicle, now_ns)

    def _get_clear(self, vehicle: VehicleState, now_ns: int) -> None:
        """Continue after a failsafe: near the ground, or at home, the drone lands; below the floor it first rises on the spot."""
        low = self._is_low(vehicle)
        if vehicle.height_m < NEAR_GROUND_M or (low and self.stage is Stage.RETURN):
            self._apply(Event.SUNK, now_ns)
        elif low:
            self._apply(Event.LOW, now_ns)

    def _is_low(self, vehicle: VehicleState) -> bool:
        """Whether a vehicle is not surely above the floor, or sinks so fast that it will not be."""
        return vehicle.height_m + _STOPS_S * min(vehicle.velocity_mps[2], 0.0) < self._floor_m + _ABOVE_FLOOR_M

    def unheard(self, now_ns: int, *, holds: bool) -> None:
        """There is no recent telemetry. ``holds``: this agent asks the autopilot to hold for now, without a change of stage."""
        self._authority = self._authority.unheard(now_ns, holds=holds)

    def step(self, situation: Situation) -> None:
        """Enter the next stage where the situation calls for it."""
        vehicle, now_ns, before = situation.vehicle, situation.now_ns, self.flight
        self._lets_go, self._asks_again = self._asks_again, False
        if vehicle is None or before.stage not in FLYING:
            return
        self.flight = before.observed(vehicle, now_ns, battery_low=situation.battery_low)
        if self.flight.is_down(vehicle):
            self._apply(Event.GROUNDED, now_ns)
            # A pilot has disarmed the vehicle: the agent makes it ready to be armed again.
            self._authority = self._authority.after(Handover.GROUNDED, now_ns)
            return
        stayed = before.position_loss.stays
        self._authority = self._authority.seen(vehicle.mode, now_ns, steered=before.is_steered and not stayed)
        if self.released:
            if self._authority.mode_lasts(now_ns):
                self._apply(_FLOWN_ON.get(self._authority.mode), now_ns)
            return
        self._watch_position(vehicle, now_ns, stayed=stayed)
        if situation.battery_spent and not self.flight.insists:
            # Landing on the spot: on the way home the battery would run empty, and the autopilot hold, climb and land from high
            # up.
            self._apply(Event.SPENT, now_ns, vehicle)
        is_taking_off = self.stage is Stage.TAKEOFF and not self.flight.rises
        cut_short = is_taking_off and is_cut_short(vehicle, self._takeoff_m)
        self._authority = self._authority.judged(View(vehicle, now_ns, self.flight, cut_short))
        if self.released:
            self._release(vehicle.mode, now_ns)
        elif not self.flight.position_loss.stays:
            self._leave_failsafe(vehicle, now_ns)
            self._progress(vehicle, situation, cut_short=cut_short)

    def _progress(self, vehicle: VehicleState, situation: Situation, *, cut_short: bool) -> None:
        """Continue the mission, by the sources found and the progress of the drone."""
        flight, now_ns = self.flight, situation.now_ns
        has_risen = vehicle.in_air and vehicle.mode in MODES[Stage.TAKEOFF] and not cut_short
        if flight.stage in SEARCHING:
            stranded_ns = since(flight.stranded_since_ns, now_ns, holds=situation.stranded_s < inf)
            self.flight = replace(flight, stranded_since_ns=stranded_ns)
        elif flight.stage is Stage.TAKEOFF and has_risen and self._is_low(vehicle):
            self.flight = replace(flight, rises=True)  # the autopilot goes by its own height, and that drifts
            return
        self._apply(self._searching.event(self.flight, situation, has_risen=has_risen), now_ns)
        if self.stage is Stage.TRACK and not situation.looks:  # a pass neither ends the search nor begins tracking
            tracking_ns = now_ns if self.flight.tracking_since_ns is None else self.flight.tracking_since_ns
            self.flight = replace(self.flight, searching_since_ns=None, tracking_since_ns=tracking_ns)

    def _watch_position(self, vehicle: VehicleState, now_ns: int, *, stayed: bool) -> None:
        """Hold while the position cannot be trusted, and land if that has brought it near the ground, or lasts too long."""
        loss = self.flight.position_loss
        if loss.lands is not None and (self.stage, Event.BLIND) in TABLE:
            self._apply(Event.BLIND, now_ns)
        elif stayed and not loss.stays:
            self._authority = self._authority.after(Handover.REGAINS, now_ns)
            if self.stage in STEERED:
                self._get_clear(vehicle, now_ns)

    def _release(self, mode: FlightMode, now_ns: int) -> None:
        self._authority = self._authority.after(Handover.OVERRULED, now_ns)
        self._apply(_FLOWN.get(mode, Event.TAKEN), now_ns)

    def _apply(self, event: Action | Event | None, now_ns: int, vehicle: VehicleState | None = None) -> None:
        """Enter the stage that the table has for the event. ``vehicle``: where it brakes before that."""
        before, self.flight = self.flight, self.flight.after(event, now_ns, vehicle, released=self.released)
        if self.flight is not before and not (before.is_steered and self.flight.is_steered):
            self._authority = self._authority.asks(now_ns)
