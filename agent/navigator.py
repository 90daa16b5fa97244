"""From what a drone knows to where it flies next: reference -> tracker -> setpoint, all in its own local frame."""

from __future__ import annotations

from math import atan2, hypot

import numpy as np

from agent.config import DroneConfig, MissionConfig
from agent.frames.graph import FrameGraph
from agent.frames.transform import Transform
from agent.fusion.estimator import Hypothesis
from agent.motion.encirclement import Encirclement
from agent.motion.fence import Fence
from agent.motion.reference import PeerState, Reference
from agent.motion.separation import PeerPlan
from agent.motion.tracker import Tracker
from agent.peers import Peers
from agent.search import Search
from agent.vehicle.interface import Setpoint, Vector3, VehicleState
from protocol.messages import Plan, Pose, Stage

REPLAN_NS = 200_000_000  # 5 Hz
HORIZON_STEP_S = 0.2
PLAN_AGE_NS = 1_000_000_000  # an older plan of a peer is not believed any more
HORIZON = 20
AT_HOME_M = 0.5
AT_HOME_MPS = 0.3
TAKING_PART = (Stage.TAKEOFF, Stage.SURVEY, Stage.TRACK, Stage.REACQUIRE)
ON_GROUND = (Stage.PREFLIGHT, Stage.LANDED)


class Navigator:
    """Plans one drone's flight while it searches or tracks."""

    def __init__(self, mission: MissionConfig, drone: DroneConfig, frames: FrameGraph, search: Search) -> None:
        self._config = mission
        self._id = drone.id
        self._frames = frames
        self._search = search
        self._lag_s = drone.vehicle_lag_s
        self._encirclement = Encirclement(mission.encirclement, mission.limits)
        self._tracker: Tracker | None = None
        self._virtual = PeerState((0.0, 0.0, 0.0))  # the tracker's own state, or the vehicle's where it begins
        self._epoch = -1
        self._due_ns = 0
        self._planned = False
        self._yaw = 0.0
        self._inverted: Transform | None = None
        self._local_from_mission = Transform()  # inverse of the above
        self._home: Vector3 | None = None  # in the mission frame

    def rest(self) -> None:
        """Another layer flies now; the next step begins from where the vehicle then is."""
        self._tracker = None

    def took_off(self, vehicle: VehicleState) -> None:
        """Keep the place that a return leads to."""
        transform = self._frames.mission_from_local(self._id, vehicle.epoch)
        self._home = transform.apply_point(vehicle.position_m) if transform is not None else None

    def at_home(self, vehicle: VehicleState) -> bool:
        """Whether the drone hovers over its home, near enough to land there."""
        transform = self._frames.mission_from_local(self._id, vehicle.epoch)
        if self._home is None or transform is None:
            return False
        x, y, _ = transform.inverse().apply_point(self._home)
        u, v, _ = vehicle.velocity_mps
        return hypot(vehicle.position_m[0] - x, vehicle.position_m[1] - y) < AT_HOME_M and hypot(u, v) < AT_HOME_MPS

    def step(
        self,
        now_ns: int,
        stage: Stage,
        since_ns: int,
        vehicle: VehicleState,
        hypothesis: Hypothesis | None,
        peers: Peers,
    ) -> tuple[Setpoint | None, Plan | None]:
        """The setpoint for now, and a new plan to publish where one was made.

        Without a transform from the mission frame there is no setpoint: the drone cannot know where the area is.
        """
        mission_from_local = self._frames.mission_from_local(self._id, vehicle.epoch)
        if mission_from_local is None:
            return None, None
        if mission_from_local is not self._inverted:
            self._inverted, self._local_from_mission = mission_from_local, mission_from_local.inverse()
        plan = None
        if self._tracker is None or self._epoch != vehicle.epoch:
            self._begin(vehicle)
        assert self._tracker is not None
        centre = self._centre(hypothesis)
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + REPLAN_NS
            plan = self._replan(now_ns, stage, since_ns, vehicle, centre, peers, mission_from_local)
        position, velocity, acceleration = self._tracker.sample(now_ns)
        self._yaw, yaw_rate = self._heading(now_ns, stage, since_ns, vehicle, centre)
        return Setpoint(position, velocity, acceleration, self._yaw, yaw_rate), plan

    def _begin(self, vehicle: VehicleState) -> None:
        corners = np.array([(x, y, 0.0) for x, y in self._config.area.polygon_m])
        corners = self._local_from_mission.apply(corners)[:, :2]
        fence = Fence.from_area(self._config.area, corners, ground_m=_ground(vehicle))
        self._tracker = Tracker(self._config.limits, fence, HORIZON_STEP_S, HORIZON, self._lag_s, drone_id=self._id)
        self._virtual = PeerState(vehicle.position_m, vehicle.velocity_mps)
        self._tracker.reset(vehicle.position_m, vehicle.velocity_mps)
        self._epoch, self._due_ns, self._planned = vehicle.epoch, 0, False

    def _centre(self, hypothesis: Hypothesis | None) -> tuple[Vector3, Vector3] | None:
        """The hypothesis and its velocity in the local frame."""
        if hypothesis is None:
            return None
        inverse = self._local_from_mission
        x, y, z = hypothesis.position.tolist()
        u, v, w = hypothesis.velocity.tolist()
        return inverse.apply_point((x, y, z)), inverse.rotate_direction((u, v, w))

    def _replan(
        self,
        now_ns: int,
        stage: Stage,
        since_ns: int,
        vehicle: VehicleState,
        centre: tuple[Vector3, Vector3] | None,
        peers: Peers,
        mission_from_local: Transform,
    ) -> Plan:
        assert self._tracker is not None
        if self._planned:
            self._virtual = self._tracker.state(now_ns)
        self._planned = True
        links = self._links(now_ns, peers)
        plans = {name: _plan_of(name, peers, link, now_ns) for name, link in links.items()}
        partners = [name for name in links if _takes_part(name, peers)]
        if stage is Stage.RETURN:
            reference = self._way_home(vehicle)
        elif stage is Stage.SURVEY or centre is None:
            reference = self._survey(vehicle, partners, mission_from_local)
        else:
            others = {name: plans[name].state(now_ns) for name in partners}
            reference = self._circle(now_ns, stage, since_ns, vehicle, centre, others)
        made = self._tracker.plan(now_ns, PeerState(vehicle.position_m, vehicle.velocity_mps), reference, [*plans.values()])
        return Plan(
            stamp_ns=made.stamp_ns,
            drone=self._id,
            epoch=vehicle.epoch,
            step_ns=round(made.step_s * 1e9),
            positions_m=tuple(map(tuple, made.positions.tolist())),
        )

    def _links(self, now_ns: int, peers: Peers) -> dict[str, Transform]:
        """``local_from_theirs`` of every drone that is heard and in the air."""
        links = {}
        for name in peers.alive(now_ns):
            pose, status = peers[name].pose, peers[name].status
            if pose is None or (status is not None and status.stage in ON_GROUND):
                continue
            theirs = self._frames.mission_from_local(name, pose.epoch)
            if theirs is not None:
                links[name] = self._local_from_mission @ theirs
        return links

    def _survey(self, vehicle: VehicleState, partners: list[str], mission_from_local: Transform) -> Reference:
        x, y, _ = mission_from_local.apply_point(self._virtual.position)
        positions, velocities = self._search.reference(sorted([self._id, *partners]), (x, y), HORIZON, HORIZON_STEP_S)
        local_from_mission = self._local_from_mission
        level = np.zeros(HORIZON + 1)
        placed = local_from_mission.apply(np.column_stack((positions, level)))
        moving = local_from_mission.rotate(np.column_stack((velocities, level)))
        placed[:, 2] = _ground(vehicle) + self._config.survey.height_m
        return Reference(placed, moving, HORIZON_STEP_S)

    def _way_home(self, vehicle: VehicleState) -> Reference:
        """Straight home at the survey's speed and height; without a known home, stay."""
        x, y, _ = self._virtual.position
        home = self._local_from_mission.apply_point(self._home) if self._home is not None else (x, y, 0.0)
        way = np.array([home[0] - x, home[1] - y])
        distance = hypot(*way.tolist())
        travelled = np.minimum(self._config.survey.speed_mps * HORIZON_STEP_S * np.arange(HORIZON + 2.0), distance)
        positions = np.empty((HORIZON + 2, 3))
        positions[:, :2] = (x, y) + travelled[:, None] * (way / max(distance, 1e-9))
        positions[:, 2] = _ground(vehicle) + self._config.survey.height_m
        return Reference(positions[:-1], np.diff(positions, axis=0) / HORIZON_STEP_S, HORIZON_STEP_S)

    def _circle(
        self,
        now_ns: int,
        stage: Stage,
        since_ns: int,
        vehicle: VehicleState,
        centre: tuple[Vector3, Vector3],
        others: dict[str, PeerState],
    ) -> Reference:
        radius_m = self._config.encirclement.radius_m
        if stage is Stage.REACQUIRE:
            radius_m += self._config.track.widening_mps * (now_ns - since_ns) * 1e-9
        (x, y, _), velocity = centre
        return self._encirclement.reference(
            self._virtual, others, self._id, center=(x, y, _ground(vehicle)), center_velocity=velocity, radius_m=radius_m
        )

    def _heading(
        self, now_ns: int, stage: Stage, since_ns: int, vehicle: VehicleState, centre: tuple[Vector3, Vector3] | None
    ) -> tuple[float, float]:
        """Always turning in the survey (paper, Sec. V-A); facing the hypothesis when tracking."""
        if stage is Stage.RETURN:
            return self._yaw, 0.0
        if stage is Stage.SURVEY or centre is None:
            rate = self._config.survey.yaw_rate_rps
            return rate * (now_ns - since_ns) * 1e-9, rate
        (cx, cy, _), _ = centre
        x, y, _ = vehicle.position_m
        return atan2(cy - y, cx - x), 0.0


def _ground(vehicle: VehicleState) -> float:
    """Local z of the ground below the vehicle, by what its rangefinder says now."""
    return vehicle.position_m[2] - vehicle.height_m


def _takes_part(name: str, peers: Peers) -> bool:
    status = peers[name].status
    return status is not None and status.stage in TAKING_PART


def _state_of(pose: Pose, link: Transform, now_ns: int) -> PeerState:
    """A peer's pose in the own local frame, and how old it is."""
    age_s = (now_ns - pose.stamp_ns) * 1e-9
    return PeerState(link.apply_point(pose.position_m), link.rotate_direction(pose.velocity_mps), age_s)


def _plan_of(name: str, peers: Peers, link: Transform, now_ns: int) -> PeerPlan:
    """A peer's plan in the own local frame; without a fresh one, its pose carried on by its velocity."""
    pose, plan = peers[name].pose, peers[name].plan
    assert pose is not None
    measured = _state_of(pose, link, now_ns)
    if plan is None or plan.epoch != pose.epoch or now_ns - plan.stamp_ns > PLAN_AGE_NS:
        return PeerPlan.from_pose(name, now_ns, measured, pose.position_sigma_m)
    ahead = link.apply(np.array(plan.positions_m))
    return PeerPlan(name, plan.stamp_ns, plan.step_ns * 1e-9, ahead, pose.position_sigma_m, measured)
