"""From what a drone knows to where it flies next: reference -> tracker -> setpoint, all in its own local frame."""

from __future__ import annotations

from math import atan2

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
from protocol.messages import Plan, Stage

REPLAN_NS = 200_000_000  # 5 Hz
HORIZON_STEP_S = 0.2
HORIZON = 20
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

    def rest(self) -> None:
        """Another layer flies now; the next step begins from where the vehicle then is."""
        self._tracker = None

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
        plan = None
        if self._tracker is None or self._epoch != vehicle.epoch:
            self._begin(vehicle, mission_from_local)
        assert self._tracker is not None
        centre = self._centre(hypothesis, mission_from_local)
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + REPLAN_NS
            plan = self._replan(now_ns, stage, since_ns, vehicle, centre, peers, mission_from_local)
        position, velocity, acceleration = self._tracker.sample(now_ns)
        yaw, yaw_rate = self._heading(now_ns, stage, since_ns, vehicle, centre)
        return Setpoint(position, velocity, acceleration, yaw, yaw_rate), plan

    def _begin(self, vehicle: VehicleState, mission_from_local: Transform) -> None:
        corners = np.array([(x, y, 0.0) for x, y in self._config.area.polygon_m])
        corners = mission_from_local.inverse().apply(corners)[:, :2]
        fence = Fence.from_area(self._config.area, corners, ground_m=vehicle.position_m[2] - vehicle.height_m)
        self._tracker = Tracker(self._config.limits, fence, HORIZON_STEP_S, HORIZON, self._lag_s, self._id)
        self._virtual = PeerState(vehicle.position_m, vehicle.velocity_mps)
        self._tracker.reset(vehicle.position_m, vehicle.velocity_mps)
        self._epoch, self._due_ns, self._planned = vehicle.epoch, 0, False

    def _centre(self, hypothesis: Hypothesis | None, mission_from_local: Transform) -> tuple[Vector3, Vector3] | None:
        """The hypothesis and its velocity in the local frame."""
        if hypothesis is None:
            return None
        inverse = mission_from_local.inverse()
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
        links = self._links(now_ns, peers, mission_from_local)
        if stage is Stage.SURVEY or centre is None:
            reference = self._survey(vehicle, peers, list(links), mission_from_local)
        else:
            reference = self._circle(now_ns, stage, since_ns, vehicle, centre, peers, links)
        plans = [_plan_of(name, peers, link, now_ns) for name, link in links.items()]
        made = self._tracker.plan(now_ns, PeerState(vehicle.position_m, vehicle.velocity_mps), reference, plans)
        return Plan(
            stamp_ns=made.stamp_ns,
            drone=self._id,
            epoch=vehicle.epoch,
            step_ns=round(made.step_s * 1e9),
            positions_m=tuple(map(tuple, made.positions.tolist())),
        )

    def _links(self, now_ns: int, peers: Peers, mission_from_local: Transform) -> dict[str, Transform]:
        """``local_from_theirs`` of every drone that is heard and in the air."""
        local_from_mission = mission_from_local.inverse()
        links = {}
        for name in peers.alive(now_ns):
            pose, status = peers[name].pose, peers[name].status
            if pose is None or (status is not None and status.stage in ON_GROUND):
                continue
            theirs = self._frames.mission_from_local(name, pose.epoch)
            if theirs is not None:
                links[name] = local_from_mission @ theirs
        return links

    def _survey(
        self, vehicle: VehicleState, peers: Peers, others: list[str], mission_from_local: Transform
    ) -> Reference:
        config = self._config
        active = sorted([self._id, *(name for name in others if _takes_part(name, peers))])
        x, y, _ = mission_from_local.apply_point(self._virtual.position)
        steps = HORIZON
        positions, velocities = self._search.reference(active, (x, y), steps, HORIZON_STEP_S)
        local_from_mission = mission_from_local.inverse()
        placed = np.column_stack((positions, np.zeros(steps + 1)))
        moving = np.column_stack((velocities, np.zeros(steps + 1)))
        placed, moving = local_from_mission.apply(placed), local_from_mission.rotate(moving)
        placed[:, 2] = vehicle.position_m[2] - vehicle.height_m + config.survey.height_m
        return Reference(placed, moving, HORIZON_STEP_S)

    def _circle(
        self,
        now_ns: int,
        stage: Stage,
        since_ns: int,
        vehicle: VehicleState,
        centre: tuple[Vector3, Vector3],
        peers: Peers,
        links: dict[str, Transform],
    ) -> Reference:
        radius_m = self._config.encirclement.radius_m
        if stage is Stage.REACQUIRE:
            radius_m += self._config.track.widening_mps * (now_ns - since_ns) * 1e-9
        others = {name: _state_of(name, peers, link, now_ns) for name, link in links.items() if _takes_part(name, peers)}
        (x, y, _), velocity = centre
        ground = vehicle.position_m[2] - vehicle.height_m
        return self._encirclement.reference(self._virtual, others, self._id, (x, y, ground), velocity, radius_m)

    def _heading(
        self, now_ns: int, stage: Stage, since_ns: int, vehicle: VehicleState, centre: tuple[Vector3, Vector3] | None
    ) -> tuple[float, float]:
        """Always turning in the survey (paper, Sec. V-A); facing the hypothesis when tracking."""
        if stage is Stage.SURVEY or centre is None:
            rate = self._config.survey.yaw_rate_rps
            return rate * (now_ns - since_ns) * 1e-9, rate
        (cx, cy, _), _ = centre
        x, y, _ = vehicle.position_m
        return atan2(cy - y, cx - x), 0.0


def _takes_part(name: str, peers: Peers) -> bool:
    status = peers[name].status
    return status is not None and status.stage in TAKING_PART


def _state_of(name: str, peers: Peers, link: Transform, now_ns: int) -> PeerState:
    """A peer's last pose in the own local frame, and how old it is."""
    pose = peers[name].pose
    assert pose is not None
    return PeerState(
        link.apply_point(pose.position_m), link.rotate_direction(pose.velocity_mps), (now_ns - pose.stamp_ns) * 1e-9
    )


def _plan_of(name: str, peers: Peers, link: Transform, now_ns: int) -> PeerPlan:
    """A peer's plan in the own local frame; without one, its pose carried on by its velocity."""
    pose, plan = peers[name].pose, peers[name].plan
    assert pose is not None
    measured, sigma_m = _state_of(name, peers, link, now_ns), pose.position_sigma_m
    if plan is not None and plan.epoch == pose.epoch:
        ahead = link.apply(np.array(plan.positions_m))
        return PeerPlan(name, plan.stamp_ns, plan.step_ns * 1e-9, ahead, sigma_m, measured)
    steps = np.arange(HORIZON + 1.0)[:, None] * HORIZON_STEP_S
    ahead = np.array(measured.position) + steps * np.array(measured.velocity)
    return PeerPlan(name, pose.stamp_ns, HORIZON_STEP_S, ahead, sigma_m, measured)
