"""From what a drone knows to where it flies next: reference -> tracker -> setpoint, all in its own local frame."""

from __future__ import annotations

from math import atan2, hypot

import numpy as np
from msgspec import Struct

from agent.config import DroneConfig, MissionConfig
from agent.frames.graph import FrameGraph
from agent.frames.transform import Transform
from agent.fusion.estimator import Hypothesis
from agent.motion.encirclement import Encirclement
from agent.motion.fence import Fence
from agent.motion.leading import Leading
from agent.motion.orbit import Orbit
from agent.motion.reference import PeerState, Reference
from agent.motion.tracker import Tracker
from agent.neighbours import Neighbour, neighbours
from agent.peers import Peers
from agent.search import InformedSearch, Search
from agent.vehicle.interface import Setpoint, Vector3, VehicleState
from protocol.messages import Plan, Stage

REPLAN_NS = 200_000_000  # 5 Hz
STEP_S = 0.2  # of the tracker's horizon
HORIZON = 20
AT_HOME_M = 0.5
AT_HOME_MPS = 0.3
_SPEED_SHARE = 0.85  # of the limit, for the circle's speed and the source's together
_ROOM_M = 3.0  # between the circle and the fence
_DOUBT_SIGMAS = 2.0  # as in agent.motion.separation


class Moment(Struct, frozen=True):
    """What a step of the navigation rests on. ``since_ns``: when the stage began; hypothesis: mission frame."""

    now_ns: int
    stage: Stage
    since_ns: int
    vehicle: VehicleState
    hypothesis: Hypothesis | None

    @property
    def stage_s(self) -> float:
        """How long the stage has lasted."""
        return (self.now_ns - self.since_ns) * 1e-9

    @property
    def ground_m(self) -> float:
        """Local z of the ground below the vehicle, by what its rangefinder says now."""
        return self.vehicle.position_m[2] - self.vehicle.height_m


class Navigator:
    """Plans one drone's flight while it searches, tracks or returns."""

    def __init__(
        self, mission: MissionConfig, drone: DroneConfig, frames: FrameGraph, search: Search, informed: InformedSearch
    ) -> None:
        self._config = mission
        self._id = drone.id
        self._lag_s = drone.vehicle_lag_s
        self._frames = frames
        self._search, self._informed = search, informed
        self._orbit = Orbit(mission.encirclement, mission.area.floor_m)
        most_mps = _SPEED_SHARE * mission.limits.speed_mps - mission.encirclement.speed_mps
        self._leading = Leading(mission.area, most_mps, mission.encirclement.radius_m + _ROOM_M)
        self._encirclement = Encirclement(mission.encirclement, mission.limits)
        self._tracker: Tracker | None = None
        self._virtual = PeerState((0.0, 0.0, 0.0))  # the tracker's own state, or the vehicle's where it begins
        self._epoch = -1
        self._due_ns = 0
        self._yaw_rad = 0.0
        self._mission_from_local = self._local_from_mission = Transform()
        self.home: Vector3 | None = None  # where a return leads, mission frame

    def took_off(self, vehicle: VehicleState) -> None:
        """Keep the place that a return leads to."""
        transform = self._frames.mission_from_local(self._id, vehicle.epoch)
        self.home = transform.apply_point(vehicle.position_m) if transform is not None else None

    def at_home(self, vehicle: VehicleState) -> bool:
        """Whether the drone hovers over its home, near enough to land there."""
        if self.home is None or not self._locate(vehicle.epoch):
            return False
        x, y, _ = self._local_from_mission.apply_point(self.home)
        u, v, _ = vehicle.velocity_mps
        return hypot(vehicle.position_m[0] - x, vehicle.position_m[1] - y) < AT_HOME_M and hypot(u, v) < AT_HOME_MPS

    def rest(self) -> None:
        """Another layer flies now; the next step begins from where the vehicle then is."""
        self._tracker = None

    def step(self, moment: Moment, peers: Peers) -> tuple[Setpoint | None, Plan | None]:
        """The setpoint for now, and a new plan to publish where one was made.

        Without a transform from the mission frame there is no setpoint: the drone cannot know where the area is.
        """
        if not self._locate(moment.vehicle.epoch):
            return None, None
        plan = None
        if self._tracker is None or self._epoch != moment.vehicle.epoch:
            self._tracker = self._begin(moment)
        elif moment.now_ns >= self._due_ns:
            self._virtual = self._tracker.state(moment.now_ns)
        centre = self._centre(moment)
        if moment.now_ns >= self._due_ns:
            self._due_ns = moment.now_ns + REPLAN_NS
            plan = self._replan(self._tracker, moment, centre, peers)
        position, velocity, acceleration = self._tracker.sample(moment.now_ns)
        self._yaw_rad, yaw_rate_rps = self._heading(moment, centre)
        return Setpoint(position, velocity, acceleration, self._yaw_rad, yaw_rate_rps), plan

    def _locate(self, epoch: int) -> bool:
        """Bring the transforms up to date; False where the frame of this epoch is not known."""
        mission_from_local = self._frames.mission_from_local(self._id, epoch)
        if mission_from_local is None:
            return False
        if mission_from_local is not self._mission_from_local:
            self._mission_from_local, self._local_from_mission = mission_from_local, mission_from_local.inverse()
        return True

    def _begin(self, moment: Moment) -> Tracker:
        vehicle = moment.vehicle
        corners = np.array([(x, y, 0.0) for x, y in self._config.area.polygon_m])
        fence = Fence.from_area(self._config.area, self._local_from_mission.apply(corners)[:, :2], ground_m=moment.ground_m)
        tracker = Tracker(self._config.limits, fence, STEP_S, HORIZON, self._lag_s, drone_id=self._id)
        tracker.reset(vehicle.position_m, vehicle.velocity_mps)
        self._virtual = PeerState(vehicle.position_m, vehicle.velocity_mps)
        self._epoch, self._due_ns = vehicle.epoch, 0
        return tracker

    def _centre(self, moment: Moment) -> tuple[Vector3, Vector3] | None:
        """Where the source is now and its velocity, in the local frame and as this drone's own localisation has it."""
        hypothesis = moment.hypothesis
        if hypothesis is None:
            return None
        x, y, z = hypothesis.sight_of(self._id).position.tolist()
        u, v, w = hypothesis.velocity.tolist()
        if hypothesis.evidence is not None:  # no other estimator knows where the source goes
            (x, y), (u, v) = self._leading.centre(moment.now_ns, hypothesis.stamp_ns, (x, y), (u, v))
        return self._local_from_mission.apply_point((x, y, z)), self._local_from_mission.rotate_direction((u, v, w))

    def _replan(self, tracker: Tracker, moment: Moment, centre: tuple[Vector3, Vector3] | None, peers: Peers) -> Plan:
        own_sigma_m = moment.vehicle.position_sigma_m
        others = neighbours(peers, self._frames, self._local_from_mission, own_sigma_m, moment.now_ns)
        partners = [other for other in others if other.takes_part]
        if moment.stage is Stage.RETURN:
            reference = self._way_home(moment)
        elif moment.stage is Stage.SURVEY or centre is None:
            reference = self._survey(moment, partners)
        else:
            reference = self._circle(moment, centre, partners)
        vehicle = moment.vehicle
        made = tracker.plan(
            moment.now_ns, PeerState(vehicle.position_m, vehicle.velocity_mps), reference, [other.plan for other in others]
        )
        return Plan(
            stamp_ns=made.stamp_ns,
            drone=self._id,
            epoch=vehicle.epoch,
            step_ns=round(made.step_s * 1e9),
            positions_m=tuple(map(tuple, made.positions.tolist())),
        )

    def _survey(self, moment: Moment, partners: list[Neighbour]) -> Reference:
        here = self._mission_from_local.apply_point(self._virtual.position)[:2]
        moves = self._mission_from_local.rotate_direction(self._virtual.velocity)[:2]
        others = [self._mission_from_local.apply_point(partner.plan.state(moment.now_ns).position)[:2] for partner in partners]
        found = self._informed.reference(moment.now_ns, here, moves, others, HORIZON, STEP_S)
        if found is None:
            active = sorted([self._id, *(partner.id for partner in partners)])
            found = self._search.reference(active, here, HORIZON, STEP_S)
        positions, velocities = found
        level = np.zeros(HORIZON + 1)
        placed = self._local_from_mission.apply(np.column_stack((positions, level)))
        moving = self._local_from_mission.rotate(np.column_stack((velocities, level)))
        placed[:, 2] = moment.ground_m + self._config.survey.height_m
        return Reference(placed, moving, STEP_S)

    def _circle(self, moment: Moment, centre: tuple[Vector3, Vector3], partners: list[Neighbour]) -> Reference:
        """Around the hypothesis: as near as it is known, by an estimator that says so and the smooth law.

        Otherwise on the configured circle, and on ever wider ones where the source has to be found again.
        """
        config, hypothesis = self._config.encirclement, moment.hypothesis
        radius_m, height_m, doubt_m = config.radius_m, config.height_m, 0.0
        if config.law == "smooth" and hypothesis is not None and hypothesis.evidence is not None:
            rms_m = hypothesis.sight_of(self._id).rms_m
            self._orbit.update(moment.now_ns, rms_m, hypothesis.activity_bq, moment.stage is Stage.REACQUIRE)
            radius_m, height_m = self._orbit.radius_m, self._orbit.height_m
            doubt_m = _DOUBT_SIGMAS * max((partner.plan.sigma_m for partner in partners), default=0.0)
        elif moment.stage is Stage.REACQUIRE:
            radius_m += self._config.track.widening_mps * moment.stage_s
        (x, y, _), velocity = centre
        return self._encirclement.reference(
            self._virtual,
            {partner.id: partner.plan.state(moment.now_ns) for partner in partners},
            self._id,
            center=(x, y, moment.ground_m),
            center_velocity=velocity,
            radius_m=radius_m,
            height_m=height_m,
            doubt_m=doubt_m,
        )

    def _way_home(self, moment: Moment) -> Reference:
        """Straight home at the survey's speed and height; without a known home, stay."""
        x, y, _ = self._virtual.position
        home = self._local_from_mission.apply_point(self.home) if self.home is not None else (x, y, 0.0)
        way = np.array([home[0] - x, home[1] - y])
        distance = hypot(*way.tolist())
        travelled = np.minimum(self._config.survey.speed_mps * STEP_S * np.arange(HORIZON + 2.0), distance)
        positions = np.empty((HORIZON + 2, 3))
        positions[:, :2] = (x, y) + travelled[:, None] * (way / max(distance, 1e-9))
        positions[:, 2] = moment.ground_m + self._config.survey.height_m
        return Reference(positions[:-1], np.diff(positions, axis=0) / STEP_S, STEP_S)

    def _heading(self, moment: Moment, centre: tuple[Vector3, Vector3] | None) -> tuple[float, float]:
        """Yaw and its rate: always turning in the survey (paper, Sec. V-A), facing the hypothesis when tracking."""
        if moment.stage is Stage.RETURN:
            return self._yaw_rad, 0.0
        if moment.stage is Stage.SURVEY or centre is None:
            rate = self._config.survey.yaw_rate_rps
            return rate * moment.stage_s, rate
        (cx, cy, _), _ = centre
        x, y, _ = moment.vehicle.position_m
        return atan2(cy - y, cx - x), 0.0
