"""Flight planning of one drone in its local frame: from the reference of the present stage to a plan and setpoints."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import partial
from math import dist

from shapely import Polygon

from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import MissionConfig
from radron.agent.frames.graph import FrameGraph
from radron.agent.frames.kept import KeptFrame
from radron.agent.geometry import Array
from radron.agent.localization.ownpose import OwnPose
from radron.agent.motion.reference import PeerState
from radron.agent.motion.tracker import Tracker, TrackerPlan
from radron.agent.navigation.guidance import Guidance
from radron.agent.navigation.home import Home, KeptHome
from radron.agent.navigation.identification import ResponseEstimator
from radron.agent.navigation.mapping import Lanes
from radron.agent.navigation.moment import HORIZON, STEP_S, Centre, Moment
from radron.agent.navigation.myself import Self
from radron.agent.navigation.neighbours import Neighbourhood
from radron.agent.navigation.ownfence import OwnFence
from radron.agent.navigation.ownground import OwnGround
from radron.agent.navigation.passing import passing
from radron.agent.navigation.peers.bearings import seen_bearings
from radron.agent.navigation.peers.newest import Peers
from radron.agent.navigation.reckoning import Reckoning
from radron.agent.navigation.surveying import InformedSearch
from radron.agent.navigation.unheard.absence import Absence
from radron.agent.navigation.unheard.contact import SILENT_NS, Wall
from radron.agent.navigation.unheard.lastnews import LastNews
from radron.agent.terrain.ground import Ground
from radron.agent.vehicle.interface import FlightMode, Setpoint, VehicleState
from radron.protocol.messages import Plan, Stage

REPLAN_NS = 200_000_000  # 5 Hz
_GAP_NS = 300_000_000  # a step later than this after the last one follows a standstill of this agent
_AGE_NS = 100_000_000  # greatest age of telemetry
_LEAP_M = 2.0  # after a standstill, the vehicle has not flown its plan if it is farther off it: the setpoint would jump so far
_TAKEN_UP_NS = 2_000_000_000  # longest time from the first setpoint until the autopilot reports offboard mode


class Navigator:
    """Flight planning of one drone in search, tracking and return.

    home: destination of a return. response: the identified response of the vehicle to setpoints.
    reckoning: context of the last plan; None while the agent does not fly the vehicle.
    revoked: this drone is revoked, so no other drone accepts its messages. excluded: ids of the other revoked drones.
    """

    def __init__(
        self,
        mission: MissionConfig,
        drone: DroneConfig,
        own: OwnPose,
        frames: FrameGraph,
        search: Lanes,
        informed: InformedSearch,
        measured: Callable[[int], Collection[str]],
    ) -> None:
        """Begin without a plan.

        Args:
            mission: the mission file.
            drone: the drone file.
            own: pose of this drone.
            frames: local frames of all drones, as estimated from the log.
            search: search by lanes.
            informed: search by waypoints of the greatest expected information.
            measured: returns the ids of drones that may fly at a stamp, because the log holds their measurements.
        """
        self._limits = mission.limits
        self._id = drone.id
        self.response = ResponseEstimator(drone.vehicle.response)
        self._own, self._measured = own, measured
        self.home = Home(self._own)
        self._ground = OwnGround(Ground.from_config(mission), self._own, mission.area)
        self._fence = OwnFence(mission.area, self._own)
        self._guidance = Guidance(mission, drone, self._own, self._ground, self.home, search, informed)
        self._neighbourhood = Neighbourhood(mission, frames, drone.id)
        self._tracker: Tracker | None = None
        self._room = Polygon()
        self.reckoning: Reckoning | None = None
        self.revoked, self.excluded = False, set[str]()
        self._virtual = PeerState((0.0, 0.0, 0.0))  # state at which the next plan begins: that of the last plan now
        self._epoch = -1
        self._due_ns = self._stepped_ns = 0
        self._begun_ns = 0
        self._was_steered = False
        self._is_resumed = False  # in-flight start of the agent: flying drones may never have been heard

    def take_off(self, vehicle: VehicleState) -> None:
        """Note the takeoff: home is where the vehicle stands."""
        self.home.took_off(vehicle)
        self._is_resumed = False

    def resume(self, home: KeptHome) -> None:
        """Note that the agent has been started in flight; ``home``: as stored by the former agent."""
        self.home.remember(home)
        self._is_resumed = True

    @property
    def waits(self) -> bool:
        """Whether the drone waits because its local frame is not known."""
        return self._guidance.waits

    @property
    def comes_down(self) -> bool:
        """Whether the drone is over home in its altitude layer, and descends, or waits there to descend; then it lands."""
        return self._guidance.comes_down

    @property
    def absence(self) -> Absence | None:
        """The missing drones, and the consequences for this one, as of the last step; None: no drone is missing."""
        return self._neighbourhood.absence

    @property
    def parted(self) -> dict[str, Wall | None]:
        """The valid separation line to each missing drone, by id; None: no line."""
        absence = self.absence
        return {name: absence.walls.get(name) for name in absence.missing} if absence is not None else {}

    @property
    def has_room(self) -> bool:
        """Whether this drone's circle while drones are missing lies inside the fence, or is not in use."""
        return self._guidance.has_room

    @property
    def frames(self) -> dict[str, KeptFrame]:
        """Local frames of all drones, by id, to be stored for a restart of the agent in flight."""
        own = self._own.kept_frame
        others = self._neighbourhood.frames.kept
        return others if own is None else {self._id: own, **others}

    @property
    def epochs(self) -> dict[str, int]:
        """Present epoch of each other drone whose frame the log does not give: its localisation has jumped, or the frame is from
        before a restart of this agent; by id.
        """
        return self._neighbourhood.frames.epochs

    def last_news(self, peers: Peers, now_ns: int) -> dict[str, LastNews]:
        """Return the last pose and separation line of each drone that flies or may fly, by id, to be stored for a restart of the
        agent in flight.
        """
        return self._neighbourhood.last_news(peers, now_ns)

    def silences_ns(self, peers: Peers, stamp_ns: int) -> dict[str, int]:
        """Return the time (ns) without a pose of each other drone at a stamp, by id, as this drone publishes it."""
        return self._neighbourhood.silences_ns(peers, stamp_ns)

    def remember(self, frames: Mapping[str, KeptFrame], others: Mapping[str, LastNews]) -> None:
        """Restore the data stored before a restart of the agent: local frames, and the last poses and lines of the others."""
        if self._id in frames:
            self._own.remember(frames[self._id])
        self._neighbourhood.frames.remember({name: kept for name, kept in frames.items() if name != self._id})
        self._neighbourhood.remember(others)

    def obeys(self, name: str, now_ns: int) -> None:
        """Note that a revoked drone has reported that it obeys, and is on its way home."""
        self._neighbourhood.obeys(name, now_ns)

    def follow(self, vehicle: VehicleState) -> None:
        """Identify the vehicle's response from telemetry: each message once, also while the agent does not fly the vehicle."""
        self.response.follow(vehicle)
        if self._tracker is None or not self._tracker.has_plan or vehicle.epoch != self._epoch:
            return
        if vehicle.mode is FlightMode.OFFBOARD:
            self.response.compare(vehicle, self._tracker.state(vehicle.stamp_ns))
            self._tracker.follow_by(self.response.response)

    def rest(self, now_ns: int, peers: Peers) -> None:
        """Note that the agent does not fly the vehicle at present. The next ``step`` makes a new plan from its position then."""
        self._tracker, self._was_steered, self.reckoning = None, False, None
        self._neighbourhood.absence = None
        if now_ns > self._due_ns:
            self._due_ns = now_ns + REPLAN_NS
            self._neighbourhood.follow(peers)

    def passing(self, now_ns: int, vehicle: VehicleState, peers: Peers) -> tuple[str, ...]:
        """Return the ids of the drones that fly too near to this one, on the ground, for its takeoff."""
        frame = self._own.frame
        local_from_mission = frame.local_from_mission if frame is not None else None
        others = self._neighbourhood.around(peers, Self(now_ns, vehicle.epoch, self._own.sigma_m, local_from_mission))
        self._neighbourhood.absence = None  # a drone on the ground misses no peers
        return passing(vehicle.position_m, others, peers, self._limits.separation_m)

    def step(self, moment: Moment, peers: Peers) -> tuple[Setpoint, Plan | None]:
        """Return the setpoint for now, and the new plan to publish if one was made in this step; else None.

        A drone whose frame is not known does not know where the area is. It waits in place, clear of the drones that it sees.
        While the vehicle does not follow the setpoints, no plan is published, and each plan begins anew at the vehicle's
        position.
        """
        plan = None
        if self._tracker is None:
            self._begun_ns = moment.now_ns
        is_steered, due = self._is_steered(moment), moment.now_ns >= self._due_ns
        has_leapt = self._tracker is not None and self._has_leapt(self._tracker, moment)
        self._stepped_ns = moment.now_ns
        if self._tracker is None or self._epoch != moment.vehicle.epoch or (due and not is_steered):
            self._guidance.begin()
            self._tracker = self._begin(moment.vehicle, moment.here)
        elif has_leapt:
            self._guidance.leap()
            self._tracker = self._begin(moment.vehicle, PeerState(moment.vehicle.position_m, moment.vehicle.velocity_mps))
        elif due:
            self._virtual = self._tracker.state(moment.now_ns)
            fence = self._fence.moved(moment.vehicle, self._ground.level_m(moment.vehicle))
            if fence is not None:
                self._tracker.confine(fence)
                self._room = fence.outline
        centre = self._guidance.centre(moment)
        if moment.now_ns >= self._due_ns:
            self._due_ns = moment.now_ns + REPLAN_NS
            plan = self._replan(self._tracker, moment, centre, peers)
        yaw_rad, yaw_rate_rps = self._guidance.heading(moment, centre)
        position, velocity, acceleration = self._tracker.sample(moment.now_ns, yaw_rate_rps)
        return Setpoint(position, velocity, acceleration, yaw_rad, yaw_rate_rps), plan if is_steered else None

    def _is_steered(self, moment: Moment) -> bool:
        """Whether the vehicle follows the setpoints: in offboard mode, or within 2 s of the first setpoint. Not under a safety
        pilot or a failsafe, and not if offboard mode was refused.
        """
        if moment.vehicle.mode is FlightMode.OFFBOARD:
            self._was_steered = True
            return True
        return not self._was_steered and moment.now_ns - self._begun_ns < _TAKEN_UP_NS

    def _has_leapt(self, tracker: Tracker, moment: Moment) -> bool:
        """Whether the vehicle has left the plan during a standstill of this agent, by telemetry since then."""
        gap_ns = moment.now_ns - self._stepped_ns
        if gap_ns < _GAP_NS or moment.now_ns - moment.vehicle.stamp_ns > gap_ns + _AGE_NS:
            return False
        return dist(tracker.state(moment.now_ns).position, moment.vehicle.position_m) > _LEAP_M

    def _begin(self, vehicle: VehicleState, here: PeerState) -> Tracker:
        """Return a new tracker whose plans begin at ``here``, the vehicle's position and velocity, in its present local frame."""
        fence = self._fence.put(vehicle, self._ground.level_m(vehicle))
        self._room = fence.outline
        tracker = Tracker(self._limits, fence, STEP_S, HORIZON, response=self.response.response, drone_id=self._id)
        tracker.reset(here.position, here.velocity)
        self._virtual = here
        self._epoch, self._due_ns = vehicle.epoch, 0
        return tracker

    def _replan(self, tracker: Tracker, moment: Moment, centre: Centre | None, peers: Peers) -> Plan:
        """Make a new plan, clear of all drones, and return the message that publishes it."""
        now_ns, vehicle, frame = moment.now_ns, moment.vehicle, self._own.frame
        ahead = partial(tracker.ahead, now_ns, vehicle.position_m)
        others = self._neighbourhood.around(peers, self._myself(moment, centre, ahead))
        partners = [other for other in others if other.takes_part]
        deviation_m = self.response.response.tracking_error_m
        plans = [other.plan for other in others]
        seen = seen_bearings(peers, vehicle.epoch, now_ns) if frame is None else ()
        reference = self._guidance.reference(moment, self._virtual, centre, partners, deviation_m, self.absence, plans, seen)
        if self._neighbourhood.listens and moment.stage is not Stage.TAKEOFF:  # it does not know yet which drones are missing
            reference = self._guidance.stay(self._virtual)
        kept_from = [*plans, *self._guidance.circles_of_others(moment, centre, self.absence, ahead)]
        wanted = self._ground.kept_off(reference, vehicle)
        made = tracker.plan(now_ns, moment.here, wanted, kept_from, self._ground.relief(vehicle))
        known = frame.mission_from_local if frame is not None else None
        divided = self._guidance.kept_places
        self.reckoning = Reckoning(
            now_ns, moment.here.position, kept_from, self._room, known, made.positions, made.step_s, divided
        )
        return self._published(made, vehicle.epoch)

    def _myself(self, moment: Moment, centre: Centre | None, ahead: Callable[[], Array]) -> Self:
        """Return the state of this drone; ``ahead``: returns the positions of its last plan from now on, (K, 3), local frame."""
        frame = self._own.frame
        return Self(
            moment.now_ns,
            moment.vehicle.epoch,
            self._own.sigma_m,
            frame.local_from_mission if frame is not None else None,
            ahead=ahead,
            step_s=STEP_S,
            motion_at=partial(self._motion_at, moment.took_part_ns),
            circle=self._guidance.circle(moment, centre),
            height_m=moment.vehicle.height_m,
            returning_s=moment.stage_s if moment.stage is Stage.RETURN else None,
            resumed=self._is_resumed,
            measured=self._measured(moment.now_ns),
            revoked=self.revoked,
            excluded=self.excluded,
            otherwise=self._own.otherwise,
            doubt_m=self._own.doubt_m,
        )

    def _motion_at(self, took_part_ns: int, stamp_ns: int) -> PeerState | None:
        """Return this drone's position and velocity at a stamp, mission frame. None if it did not take part then, or the other
        drones could not know of it yet by a status.
        """
        return self._own.motion_at(stamp_ns) if stamp_ns >= took_part_ns + SILENT_NS else None

    def _published(self, made: TrackerPlan, epoch: int) -> Plan:
        """Return the message that publishes a plan."""
        return Plan(
            stamp_ns=made.stamp_ns,
            drone=self._id,
            epoch=epoch,
            step_ns=round(made.step_s * 1e9),
            positions_m=tuple(map(tuple, made.positions.tolist())),
        )
