"""From what a drone knows to where it flies next: reference -> tracker -> setpoint, all in its own local frame."""

from __future__ import annotations

from agent.config import DroneConfig, MissionConfig
from agent.frames.graph import FrameGraph
from agent.ground import Ground
from agent.guidance import HORIZON, STEP_S, Centre, Guidance, Moment
from agent.home import Home
from agent.motion.reference import PeerState
from agent.motion.tracker import Tracker
from agent.neighbours import Neighbourhood, Self
from agent.ownfence import OwnFence
from agent.ownframe import OwnFrame
from agent.ownground import OwnGround
from agent.peers import Peers
from agent.search import InformedSearch, Search
from agent.vehicle.interface import Setpoint, VehicleState
from protocol.messages import Plan

REPLAN_NS = 200_000_000  # 5 Hz


class Navigator:
    """Plans one drone's flight while it searches, tracks or returns. ``home``: where a return leads."""

    def __init__(
        self, mission: MissionConfig, drone: DroneConfig, frames: FrameGraph, search: Search, informed: InformedSearch
    ) -> None:
        self._limits = mission.limits
        self._id = drone.id
        self._lag_s = drone.vehicle_lag_s
        self._own = OwnFrame(drone.id, frames)
        self.home = Home(self._own)
        self._ground = OwnGround(Ground.from_config(mission), self._own)
        self._fence = OwnFence(mission.area, self._own)
        self._guidance = Guidance(mission, drone, self._own, self._ground, self.home, search, informed)
        self._neighbourhood = Neighbourhood(mission, frames)
        self._tracker: Tracker | None = None
        self._virtual = PeerState((0.0, 0.0, 0.0))  # the tracker's own state, or the vehicle's where it begins
        self._epoch = -1
        self._due_ns = 0

    @property
    def waits(self) -> bool:
        """Whether the drone does not know its frame and waits for it."""
        return self._guidance.waits

    def follow(self, vehicle: VehicleState) -> None:
        """Take telemetry, each once, also while another layer flies."""
        self._own.follow(vehicle)

    def rest(self) -> None:
        """Another layer flies now; the next step begins from where the vehicle then is."""
        self._tracker = None

    def step(self, moment: Moment, peers: Peers) -> tuple[Setpoint, Plan | None]:
        """The setpoint for now, and a new plan to publish where one was made.

        A drone that does not know its frame cannot know where the area is: it waits where it is, out of the way of whom it sees.
        """
        self._own.locate(moment.vehicle.epoch)
        plan = None
        if self._tracker is None or self._epoch != moment.vehicle.epoch:
            self._tracker = self._begin(moment.vehicle)
        elif moment.now_ns >= self._due_ns:
            self._virtual = self._tracker.state(moment.now_ns)
            fence = self._fence.moved(moment.vehicle)
            if fence is not None:
                self._tracker.confine(fence)
        centre = self._guidance.centre(moment)
        if moment.now_ns >= self._due_ns:
            self._due_ns = moment.now_ns + REPLAN_NS
            plan = self._replan(self._tracker, moment, centre, peers)
        position, velocity, acceleration = self._tracker.sample(moment.now_ns)
        return Setpoint(position, velocity, acceleration, *self._guidance.heading(moment, centre)), plan

    def _begin(self, vehicle: VehicleState) -> Tracker:
        """From where the vehicle is, also after a jump of its localisation: in the new epoch's frame it has not moved."""
        self._guidance.begin()
        fence = self._fence.put(vehicle, self._ground.level_m(vehicle))
        tracker = Tracker(self._limits, fence, STEP_S, HORIZON, self._lag_s, drone_id=self._id)
        tracker.reset(vehicle.position_m, vehicle.velocity_mps)
        self._virtual = PeerState(vehicle.position_m, vehicle.velocity_mps)
        self._epoch, self._due_ns = vehicle.epoch, 0
        return tracker

    def _replan(self, tracker: Tracker, moment: Moment, centre: Centre | None, peers: Peers) -> Plan:
        vehicle = moment.vehicle
        local_from_mission = self._own.local_from_mission if self._own.is_known else None
        me = Self(moment.now_ns, vehicle.epoch, self._own.sigma_m(vehicle), local_from_mission)
        others = self._neighbourhood.around(peers, me)
        partners = [other for other in others if other.takes_part]
        made = tracker.plan(
            moment.now_ns,
            PeerState(vehicle.position_m, vehicle.velocity_mps),
            self._guidance.reference(moment, self._virtual, centre, partners),
            [other.plan for other in others],
            self._ground.relief(vehicle),
        )
        return Plan(
            stamp_ns=made.stamp_ns,
            drone=self._id,
            epoch=vehicle.epoch,
            step_ns=round(made.step_s * 1e9),
            positions_m=tuple(map(tuple, made.positions.tolist())),
        )
