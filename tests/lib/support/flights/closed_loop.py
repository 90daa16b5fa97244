"""A swarm of trackers in closed loop with its own model of the vehicles: independent of ``sim`` and of the agent's assumptions.

The vehicle is a cascade as PX4's is: setpoints that arrive late, a position loop P, a velocity loop PID, both with feed-forward,
a lagging attitude and drag.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from radron.agent.config.drone import ResponseConfig
from radron.agent.config.mission import AreaConfig, EncirclementConfig, LimitsConfig
from radron.agent.motion.encirclement import Encirclement
from radron.agent.motion.fence import Fence
from radron.agent.motion.reference import PeerState, Reference
from radron.agent.motion.separation import PeerPlan
from radron.agent.motion.tracker import Tracker
from radron.agent.navigation.identification import ResponseEstimator
from radron.agent.vehicle.interface import FlightMode, VehicleState

Array = NDArray[np.float64]
Law = Callable[[PeerState, Mapping[str, PeerState], str], Reference]

TICK_S = 0.05
TICK_NS = 50_000_000
REPLAN_TICKS = 4  # 5 Hz
POSE_TICKS = 2  # 10 Hz
DELAY_TICKS = 1  # 50 ms
DRIFT_S = 20.0  # correlation time of the localisation error
LOCALISATION_M = 0.13  # horizontal, 1 sigma
VELOCITY_MPS = 0.07
VELOCITY_DRIFT_S = 3.0
HEIGHT_M = 3.0
WIDE = Fence.from_area(AreaConfig(polygon_m=((-200.0, -200.0), (200.0, -200.0), (200.0, 200.0), (-200.0, 200.0))))


@dataclass(slots=True)
class Vehicle:
    """A vehicle with a cascade as PX4's. position, velocity: (3,), true; acceleration: (3,), by the thrust.

    ``drag``, ``quadratic``: air drag (1/s; 1/m). ``feedforward``: the autopilot's gain on commanded accelerations.
    """

    position: Array
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    acceleration: Array = field(default_factory=lambda: np.zeros(3))
    position_gain: float = 0.95
    velocity_gain: float = 1.8
    integral_gain: float = 0.4
    derivative_gain: float = 0.2
    attitude_lag_s: float = 0.22
    drag: float = 0.5
    quadratic: float = 0.0
    feedforward: float = 1.0
    delay_ticks: int = 1
    yaw_rate_rps: float = 0.0  # with which it turns all the time, its thrust along with it
    limit_mps2: float = 9.0
    wind: Array = field(default_factory=lambda: np.zeros(3))
    queue: deque[tuple[Array, Array, Array]] = field(default_factory=deque)
    integral: Array = field(default_factory=lambda: np.zeros(3))
    damped: Array = field(default_factory=lambda: np.zeros(3))  # dv/dt by a low-pass

    def step(self, setpoint: tuple[Array, Array, Array], error: Array, velocity_error: Array) -> None:
        """One tick; setpoint: position, velocity, acceleration (3,) each; errors (3,): error of its localisation."""
        self.queue.append(setpoint)
        position, velocity, acceleration = self.queue.popleft() if len(self.queue) > self.delay_ticks else self.queue[0]
        fine = 10
        h = TICK_S / fine
        for _ in range(fine):
            wanted = velocity + self.position_gain * (position - self.position - error)
            lacking = wanted - self.velocity - velocity_error
            asked = self.feedforward * acceleration + self.velocity_gain * lacking + self.integral
            asked = asked - self.derivative_gain * self.damped
            limited = asked * min(1.0, self.limit_mps2 / max(float(np.hypot(asked[0], asked[1])), 1e-9))
            self.integral = self.integral + h * self.integral_gain * (lacking - 2.0 / self.velocity_gain * (asked - limited))
            turning = self.yaw_rate_rps * np.array([-self.acceleration[1], self.acceleration[0], 0.0])
            self.acceleration = self.acceleration + h * ((limited - self.acceleration) / self.attitude_lag_s + turning)
            air = self.velocity - self.wind
            rate = self.acceleration - (self.drag + self.quadratic * float(np.linalg.norm(air))) * air
            self.damped = self.damped + h * 2.0 * np.pi * 5.0 * (rate - self.damped)
            self.position = self.position + h * self.velocity
            self.velocity = self.velocity + h * rate

    def quaternion(self) -> tuple[float, float, float, float]:
        """Attitude (w, x, y, z) with yaw 0 and thrust for the horizontal acceleration."""
        x, y = float(self.acceleration[0]) / 9.80665, float(self.acceleration[1]) / 9.80665
        half = np.array([1.0 + np.sqrt(1.0 + x * x + y * y), -y, x, 0.0])  # the shortest turn of up to (x, y, 1)
        w, i, j, k = (half / np.linalg.norm(half)).tolist()
        return w, i, j, k


@dataclass(frozen=True, slots=True)
class Flight:
    """Record of the flight. time: (T,); position, velocity: (T, N, 3), true; statuses: one for each plan made.

    deviation: (T, N), horizontal distance from the plan by the own localisation.
    """

    time: Array
    position: Array
    velocity: Array
    deviation: Array
    statuses: list[str]

    def gap_errors_deg(self, center: Array) -> Array:
        """(T, N): by how much each gap between neighbours around the centre (2,) or (T, 2) differs from uniform."""
        relative = self.position[:, :, :2] - np.atleast_2d(center)[:, None]
        angles = np.sort(np.arctan2(relative[..., 1], relative[..., 0]), axis=1)
        gaps = np.diff(np.concatenate((angles, angles[:, :1] + 2.0 * np.pi), axis=1), axis=1)
        errors: Array = np.rad2deg(gaps) - 360.0 / self.position.shape[1]
        return errors

    def settling_s(self, center: Array, within_deg: float = 5.0) -> float:
        """Time after which every gap stays within this of uniform."""
        outside = np.flatnonzero(np.abs(self.gap_errors_deg(center)).max(axis=1) > within_deg)
        return float((outside[-1] + 1) * TICK_S) if len(outside) else 0.0

    def after(self, seconds: float) -> Flight:
        """Without the first seconds."""
        keep = self.time >= self.time[0] + seconds
        return Flight(self.time[keep], self.position[keep], self.velocity[keep], self.deviation[keep], self.statuses)

    def speeds(self) -> Array:
        """(T, N), horizontal."""
        return np.hypot(self.velocity[..., 0], self.velocity[..., 1])

    def closest_m(self) -> float:
        """Least horizontal distance of any two drones."""
        first, second = np.triu_indices(self.position.shape[1], 1)
        apart = self.position[:, first, :2] - self.position[:, second, :2]
        return float(np.linalg.norm(apart, axis=2).min()) if len(first) else float("inf")


class Swarm:
    """N drones, each with its tracker, that fly by a law. Everything random follows from the generator given."""

    def __init__(
        self,
        rng: np.random.Generator,
        starts: Array,
        *,
        noise: float = 1.0,
        fence: Fence = WIDE,
        poses_only: bool = False,
        response: ResponseConfig | None = None,
        **vehicle: float | Array,
    ) -> None:
        """``starts``: (N, 2). ``noise`` scales all of it. ``poses_only``: the law sees measured poses, not states of plans.

        ``response``: the assumed response of the vehicles; ``vehicle``: how they are.
        """
        self.rng, self.noise, self.poses_only = rng, noise, poses_only
        self.names = [f"d{k}" for k in range(len(starts))]
        self.vehicles = [Vehicle(np.array([x, y, HEIGHT_M]), **vehicle) for x, y in starts]
        self.trackers = [Tracker(LimitsConfig(), fence, drone_id=name) for name in self.names]
        self.responses = [ResponseEstimator(response or ResponseConfig()) for _ in starts]
        self.error: Array = self._sigma() * rng.standard_normal((len(starts), 3))
        self.velocity_error: Array = VELOCITY_MPS * noise * rng.standard_normal((len(starts), 3))
        self.tick = 0
        self._planned = [False] * len(starts)
        self._poses: list[tuple[int, PeerState]] = []  # newest heard: tick, state
        self._plans: list[PeerPlan | None] = [None] * len(starts)
        self._mail: deque[tuple[int, int, PeerPlan]] = deque()  # due tick, drone, plan
        self._post: deque[tuple[int, list[tuple[int, PeerState]]]] = deque()  # due tick, poses of all

    def fly(self, duration_s: float, law: Law) -> Flight:
        """Fly on by this law."""
        times, positions, velocities, deviations, statuses = [], [], [], [], []
        keep, keep_fast = float(np.exp(-TICK_S / DRIFT_S)), float(np.exp(-TICK_S / VELOCITY_DRIFT_S))
        for _ in range(round(duration_s / TICK_S)):
            self._communicate()
            for drone in range(len(self.names)):
                if self.tick % REPLAN_TICKS == drone % REPLAN_TICKS or not self._planned[drone]:
                    statuses.append(self._replan(drone, law))
            deviations.append([self._compare(drone) for drone in range(len(self.names))])
            for drone, (vehicle, tracker) in enumerate(zip(self.vehicles, self.trackers, strict=True)):
                position, velocity, acceleration = tracker.sample(self.tick * TICK_NS, vehicle.yaw_rate_rps)
                setpoint = np.array(position), np.array(velocity), np.array(acceleration)
                vehicle.step(setpoint, self.error[drone], self.velocity_error[drone])
            shape = self.error.shape
            self.error = keep * self.error + (1.0 - keep**2) ** 0.5 * self._sigma() * self.rng.standard_normal(shape)
            fresh = VELOCITY_MPS * self.noise * self.rng.standard_normal(shape)
            self.velocity_error = keep_fast * self.velocity_error + (1.0 - keep_fast**2) ** 0.5 * fresh
            times.append(self.tick * TICK_S)
            positions.append([vehicle.position for vehicle in self.vehicles])
            velocities.append([vehicle.velocity for vehicle in self.vehicles])
            self.tick += 1
        return Flight(np.array(times), np.array(positions), np.array(velocities), np.array(deviations), statuses)

    def measured(self, drone: int) -> PeerState:
        """Pose by the drone's own localisation now."""
        vehicle = self.vehicles[drone]
        x, y, z = (vehicle.position + self.error[drone]).tolist()
        u, v, w = (vehicle.velocity + self.velocity_error[drone]).tolist()
        return PeerState((x, y, z), (u, v, w))

    def _compare(self, drone: int) -> float:
        """Telemetry of a drone to what finds its response; how far it is from its plan."""
        now_ns, me, response = self.tick * TICK_NS, self.measured(drone), self.responses[drone]
        planned = self.trackers[drone].state(now_ns)
        telemetry = VehicleState(
            stamp_ns=now_ns,
            epoch=0,
            position_m=me.position,
            velocity_mps=me.velocity,
            quaternion=self.vehicles[drone].quaternion(),
            height_m=HEIGHT_M,
            position_sigma_m=LOCALISATION_M,
            yaw_sigma_rad=0.0,
            mode=FlightMode.OFFBOARD,
            armed=True,
            in_air=True,
            healthy=True,
        )
        response.follow(telemetry)
        response.compare(telemetry, planned)
        self.trackers[drone].follow_by(response.response)
        return float(np.hypot(me.position[0] - planned.position[0], me.position[1] - planned.position[1]))

    def _sigma(self) -> float:
        return float(LOCALISATION_M / np.sqrt(2.0) * self.noise)

    def _communicate(self) -> None:
        if self.tick % POSE_TICKS == 0:
            poses = [(self.tick, self.measured(drone)) for drone in range(len(self.names))]
            self._post.append((self.tick + DELAY_TICKS, poses))
            if not self._poses:
                self._poses = poses  # heard each other on the ground
        while self._post and self._post[0][0] <= self.tick:
            self._poses = self._post.popleft()[1]
        while self._mail and self._mail[0][0] <= self.tick:
            _, drone, plan = self._mail.popleft()
            self._plans[drone] = plan

    def _replan(self, drone: int, law: Law) -> str:
        now_ns, me = self.tick * TICK_NS, self.measured(drone)
        others, plans = {}, []
        for other, name in enumerate(self.names):
            if other == drone:
                continue
            stamp, state = self._poses[other]
            pose = PeerState(state.position, state.velocity, (self.tick - stamp) * TICK_S)
            plan = self._plans[other]
            if plan is None:
                plan = PeerPlan.from_pose(name, now_ns, pose, LOCALISATION_M)
            plans.append(PeerPlan(name, plan.stamp_ns, plan.step_s, plan.positions, plan.sigma_m, pose))
            others[name] = pose if self.poses_only else plan.state(now_ns)
        tracker = self.trackers[drone]
        virtual = tracker.state(now_ns) if self._planned[drone] else me
        made = tracker.plan(now_ns, me, law(virtual, others, self.names[drone]), plans)
        self._planned[drone] = True
        published = PeerPlan(self.names[drone], made.stamp_ns, made.step_s, made.positions.tolist(), LOCALISATION_M)
        self._mail.append((self.tick + DELAY_TICKS, drone, published))
        return str(made.status)


def encircle(
    center: tuple[float, float], law: str = "smooth", config: EncirclementConfig | None = None, limits: LimitsConfig | None = None
) -> Law:
    """The law of a swarm that circles this place, its ground at z = 0."""
    if config is None:
        config = EncirclementConfig(law="paper") if law == "paper" else EncirclementConfig()
    encirclement = Encirclement(config, limits or LimitsConfig())

    def reference(me: PeerState, others: Mapping[str, PeerState], my_id: str) -> Reference:
        return encirclement.reference(me, others, my_id, center=(*center, 0.0))

    return reference


def go_to(goals: Mapping[str, tuple[float, float]], speed_mps: float = 4.0) -> Law:
    """Straight to a goal of one's own."""
    times = 0.2 * np.arange(21.0)

    def reference(me: PeerState, _: Mapping[str, PeerState], my_id: str) -> Reference:
        way = np.array([*goals[my_id], HEIGHT_M]) - me.position
        length = max(float(np.linalg.norm(way)), 1e-9)
        travelled = np.minimum(speed_mps * times, length)
        moving = speed_mps * (speed_mps * times < length)
        return Reference(me.position + np.outer(travelled, way / length), np.outer(moving, way / length), 0.2)

    return reference


def scattered(rng: np.random.Generator, drones: int = 5, reach_m: float = 30.0, apart_m: float = 6.0) -> Array:
    """Arbitrary starting places (N, 2), as far apart as any launch would be."""
    while True:
        places = rng.uniform(-reach_m, reach_m, (drones, 2))
        if float((np.linalg.norm(places[:, None] - places[None], axis=2) + 2.0 * reach_m * np.eye(drones)).min()) > apart_m:
            return places
