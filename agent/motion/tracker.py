"""MPC trajectory tracker: from a reference that jumps to a plan that the vehicle can fly (after Baca et al. 2018).

The tracker drives a virtual vehicle, a triple integrator, whose state is free of measurement noise; the real one follows it. At
every replan the virtual vehicle's next seconds are optimised to follow the reference within the limits. Mostly no limit is
active, and the answer is a matrix product (``prediction``); where one is, OSQP solves the constrained problem (``qp``); and where
that fails or the vehicles come too close to each other, the plan is to brake.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from math import hypot

import numpy as np

from agent.config import LimitsConfig
from agent.motion.fence import Fence
from agent.motion.prediction import predict
from agent.motion.qp import OCTAGON_INRADIUS, HalfPlanes, LimitedProblem
from agent.motion.reference import Array, PeerState, Reference, Vector3
from agent.motion.separation import PeerPlan, escape, half_planes, keep_away, sampled

_DEPARTED_M = 5.0  # a vehicle further than this from the virtual one does not follow it: start again from where it is
_ROWS = 3  # half-planes per step in the constrained problem
_NEAR_M = 2.0  # half-planes nearer than this to the plan enter the problem
_FENCE_INSIDE_M = 1.5  # plans stay this far inside the fence, for what the vehicle deviates from them
_FENCE_YIELDS = 4.0  # the fence gives way before the separation does
_HEIGHT_INSIDE_M = 0.5
_DEVIATION_S = 1.0  # time constant at which vehicles come back to their plans
_BRAKING_TIME_S = 0.5  # time constant at which the last resort reaches its velocity
_CURVATURE_S2 = 1.1  # by PX4's cascade a vehicle flies turns wide by this times the acceleration (0.7-1.1 m at 0.75 m/s2)

_Near = list[tuple[PeerPlan, Array, float]]  # peer, its positions (H + 1, 2) over the horizon, distance to keep


class Status(StrEnum):
    """How a plan came about."""

    FREE = "free"  # no limit active
    CONSTRAINED = "constrained"  # solved within limits
    BRAKING = "braking"  # no solution: brake
    ESCAPING = "escaping"  # too close to another drone: brake or back off


@dataclass(frozen=True, slots=True)
class TrackerPlan:
    """The virtual vehicle from now on. positions, velocities, accelerations: (H + 1, 3), at stamp_ns, stamp_ns + step_s, ..."""

    stamp_ns: int
    step_s: float
    positions: Array
    velocities: Array
    accelerations: Array
    status: Status


class Tracker:
    """Plans at a few hertz; ``sample`` gives setpoints in between, at any rate."""

    def __init__(
        self,
        limits: LimitsConfig,
        fence: Fence,
        step_s: float = 0.2,
        horizon: int = 20,
        lead_s: float = 0.38,
        *,
        drone_id: str = "",
    ) -> None:
        """``lead_s``: by which the vehicle follows its setpoints late. ``drone_id`` decides on the right of way."""
        self._limits, self._fence = limits, fence
        self._step_s, self._horizon, self._lead_s, self._id = step_s, horizon, lead_s, drone_id
        self._prediction = prediction = predict(horizon, step_s)
        flat = (limits.speed_mps, limits.acceleration_mps2, limits.jerk_mps3)
        upright = (limits.climb_mps, 0.5 * limits.acceleration_mps2, limits.jerk_mps3)
        self._flat = LimitedProblem(prediction, step_s, 2, flat, _ROWS)
        self._upright = LimitedProblem(prediction, step_s, 1, upright, 2)
        self._within = np.array([limits.speed_mps * OCTAGON_INRADIUS, limits.acceleration_mps2 * OCTAGON_INRADIUS]) ** 2
        self._upright_limits = upright
        self._times: Array = step_s * np.arange(horizon + 1, dtype=np.float64)
        self._fading: Array = np.exp(-self._times / _DEVIATION_S)[:, None]
        self._plan: TrackerPlan | None = None
        self._guess: Array = np.zeros((horizon, 3))
        self._start: tuple[Vector3, Vector3] | None = None
        self._segments: list[tuple[list[float], list[float], list[float], list[float]]] = []

    def reset(self, position: Vector3, velocity: Vector3 = (0.0, 0.0, 0.0)) -> None:
        """Start again from here, at rest as for acceleration: after a change of mode or a jump of the frame."""
        self._plan = None
        self._start = (position, velocity)

    def state(self, now_ns: int) -> PeerState:
        """The virtual vehicle now (without lead)."""
        position, velocity, _ = self._at((now_ns - self._stamp_ns) * 1e-9)
        return PeerState(position, velocity)

    def plan(self, now_ns: int, state: PeerState, reference: Reference, peers: Sequence[PeerPlan] = ()) -> TrackerPlan:
        """Replan. ``state``: the vehicle's own measured position and velocity; ``reference`` begins now."""
        start = self._continued(now_ns, state)
        horizon, origin = self._horizon, start[0]
        wanted = self._wanted(reference)
        wanted[2 : 2 + horizon] -= origin
        wanted[:2] = start[1:]
        optimum = (self._prediction.optimum @ wanted).reshape(4, horizon, 3)
        optimum[1] += origin
        jerk = optimum[0]
        deviation = (state.position[0] - float(origin[0]), state.position[1] - float(origin[1]))
        status, flat = self._flat_jerk(now_ns, start, optimum, deviation, peers)
        if flat is None or status is Status.BRAKING:
            status, flat = self._last_resort(start, state, peers, flat)
        upright_status, upright = self._upright_jerk(start, optimum)
        if status is not Status.FREE or upright_status is not Status.FREE:
            jerk = np.column_stack((flat, upright))
            states = (self._prediction.forced @ jerk + self._prediction.free @ start[1:]).reshape(3, horizon, 3)
            states[0] += origin
            status = upright_status if status is Status.FREE else status
        else:
            states = optimum[1:]
        return self._adopt(now_ns, start, states, jerk, status)

    def sample(self, now_ns: int) -> tuple[Vector3, Vector3, Vector3]:
        """Setpoint for now: position, velocity, acceleration, ahead of the vehicle by as much as it follows late.

        A cascade of position and velocity control flies p - C a where it is told p, with C near 1 / (k_p k_v); told p + C a, it
        flies p.
        """
        (x, y, z), velocity, acceleration = self._at((now_ns - self._stamp_ns) * 1e-9 + self._lead_s)
        x += _CURVATURE_S2 * acceleration[0]
        y += _CURVATURE_S2 * acceleration[1]
        return (x, y, z), velocity, acceleration

    @property
    def _stamp_ns(self) -> int:
        if self._plan is None:
            raise RuntimeError("the tracker has no plan yet: call plan() first")
        return self._plan.stamp_ns

    def _at(self, time_s: float) -> tuple[Vector3, Vector3, Vector3]:
        """The virtual vehicle so long after the plan's stamp; at the plan's end it stops."""
        step = self._step_s
        index = int(time_s / step)
        if index >= self._horizon:
            x, y, z = self._end
            return (x, y, z), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        (px, py, pz), (vx, vy, vz), (ax, ay, az), (jx, jy, jz) = self._segments[max(index, 0)]
        t = time_s - max(index, 0) * step
        h, s = 0.5 * t, t / 3.0
        return (
            (px + t * (vx + h * (ax + s * jx)), py + t * (vy + h * (ay + s * jy)), pz + t * (vz + h * (az + s * jz))),
            (vx + t * (ax + h * jx), vy + t * (ay + h * jy), vz + t * (az + h * jz)),
            (ax + t * jx, ay + t * jy, az + t * jz),
        )

    def _continued(self, now_ns: int, state: PeerState) -> Array:
        """State (3, 3) that the plan begins with: the virtual vehicle's, unless the real one is elsewhere."""
        if self._plan is None:
            position, velocity = self._start or (state.position, state.velocity)
            self._start = None
            return np.array([position, velocity, (0.0, 0.0, 0.0)])
        virtual = self._at((now_ns - self._plan.stamp_ns) * 1e-9)
        gap = [a - b for a, b in zip(virtual[0], state.position, strict=True)]
        if hypot(*gap) > _DEPARTED_M:
            self._plan = None
            return np.array([state.position, state.velocity, (0.0, 0.0, 0.0)])
        return np.array(virtual)

    def _wanted(self, reference: Reference) -> Array:
        """Reference at the steps 1 .. H in the layout (2 + 2 H, 3) of ``Prediction.optimum``; heights within the fence."""
        horizon, count = self._horizon, len(reference.positions) - 1
        wanted = np.empty((2 + 2 * horizon, 3))
        positions, velocities = wanted[2 : 2 + horizon], wanted[2 + horizon :]
        if reference.step_s == self._step_s and count >= horizon:
            positions[:], velocities[:] = reference.positions[1 : horizon + 1], reference.velocities[1 : horizon + 1]
        else:
            known = np.arange(count + 1) * reference.step_s
            after = np.maximum(0.0, self._times[1:] - known[-1])
            for axis in range(3):
                velocities[:, axis] = np.interp(self._times[1:], known, reference.velocities[:, axis])
                positions[:, axis] = np.interp(self._times[1:], known, reference.positions[:, axis]) + after * velocities[:, axis]
        low, high = self._fence.floor_m + _HEIGHT_INSIDE_M, self._fence.ceiling_m - _HEIGHT_INSIDE_M
        np.clip(positions[:, 2], low, max(low, high), out=positions[:, 2])
        return wanted

    def _flat_jerk(
        self, now_ns: int, start: Array, optimum: Array, deviation: tuple[float, float], peers: Sequence[PeerPlan]
    ) -> tuple[Status, Array | None]:
        """Horizontal jerks (H, 2) within limits, separation and fence; None where there is no solution."""
        jerk, position = optimum[:2, :, :2]
        squares = np.einsum("skx,skx->sk", optimum[2:, :, :2], optimum[2:, :, :2]).max(axis=1)
        free = bool(squares[0] <= self._within[0] and squares[1] <= self._within[1])
        free = free and float(np.abs(jerk).max()) <= self._limits.jerk_mps3
        near: _Near = []
        for peer in peers:
            other = peer.at(now_ns, self._times)
            self._correct(other, peer, deviation)
            keep = keep_away(self._id, peer, self._limits.separation_m)
            apart = position - other[1:]
            clearance = float(np.einsum("kx,kx->k", apart, apart).min()) ** 0.5 - keep
            if clearance < _NEAR_M:
                near.append((peer, other, keep))
                free = free and clearance >= 0.0
        normals, offsets = self._fence.half_planes(float(start[0, 0]), float(start[0, 1]))
        clearances = position @ normals.T - (offsets + _FENCE_INSIDE_M)
        least = clearances.min(axis=0)
        free = free and float(least.min()) >= 0.0
        if free:
            return Status.FREE, jerk
        rows = [(normals[m], offsets[m] + _FENCE_INSIDE_M) for m in np.flatnonzero(least < _NEAR_M).tolist()]
        planes = self._collect(now_ns, start, position, near, rows)
        found = self._flat.solve(start[:, :2], optimum[:, :, :2], planes, self._guess[:, :2])
        if found is None:
            return Status.BRAKING, None
        return (
            Status.CONSTRAINED if self._apart(position + self._prediction.position @ (found - jerk), near) else Status.BRAKING
        ), found

    def _apart(self, position: Array, near: _Near) -> bool:
        """Whether a solution (H, 2) keeps the bare separation from the others, as far as that is in its hands.

        Where the distance is growing already there is nothing better to do.
        """
        for _, other, _ in near:
            apart = np.einsum("kx,kx->k", position - other[1:], position - other[1:])
            if float(apart.min()) < self._limits.separation_m**2 and float(apart.min()) < float(apart[0]):
                return False
        return True

    def _correct(self, other: Array, peer: PeerPlan, deviation: tuple[float, float]) -> None:
        """Move a peer's planned positions (H + 1, 2) by what it deviates from its plan and I from mine, fading along the horizon.

        Plans are kept apart, but vehicles collide.
        """
        x, y = -deviation[0], -deviation[1]
        if peer.measured is not None:
            (px, py, _), (vx, vy, _), age = peer.measured.position, peer.measured.velocity, peer.measured.age_s
            x += px + age * vx - float(other[0, 0])
            y += py + age * vy - float(other[0, 1])
        other += self._fading * np.array((x, y))

    def _collect(
        self,
        now_ns: int,
        start: Array,
        position: Array,
        near: list[tuple[PeerPlan, Array, float]],
        fence: list[tuple[Array, float]],
    ) -> HalfPlanes | None:
        """The half-planes of peers and fence; per step, those that the unconstrained optimum violates most."""
        if not near and not fence:
            return None
        horizon = self._horizon
        if self._plan is None:
            nominal = np.repeat(start[None, 0, :2], horizon, axis=0)
        else:
            nominal = sampled(self._plan.positions, (now_ns - self._plan.stamp_ns) * 1e-9, self._step_s, self._times[1:])
        here = (float(start[0, 0]), float(start[0, 1]))
        count = max(_ROWS, len(near) + len(fence))
        normals, offsets, yielding = np.zeros((count, horizon, 2)), np.full((count, horizon), -np.inf), np.ones((count, horizon))
        for row, (peer, other, keep) in enumerate(near):
            normals[row], offsets[row] = half_planes(nominal, here, other, keep, peer.id < self._id)
        for row, (normal, offset) in enumerate(fence, start=len(near)):
            normals[row], offsets[row], yielding[row] = normal, offset, _FENCE_YIELDS
        if count > _ROWS:
            slack = np.einsum("rkx,kx->rk", normals, position) - offsets
            worst = np.argsort(slack, axis=0, kind="stable")[:_ROWS]
            steps = np.arange(horizon)
            normals, offsets, yielding = normals[worst, steps], offsets[worst, steps], yielding[worst, steps]
        return HalfPlanes(normals, offsets, yielding)

    def _upright_jerk(self, start: Array, optimum: Array) -> tuple[Status, Array]:
        """Vertical jerks (H,) within limits, floor and ceiling."""
        jerk, position, velocity, acceleration = optimum[:, :, 2]
        speed, pull, rate = self._upright_limits
        low, high = self._fence.floor_m, self._fence.ceiling_m
        if (
            float(np.abs(velocity).max()) <= speed
            and float(np.abs(acceleration).max()) <= pull
            and float(np.abs(jerk).max()) <= rate
            and float(position.min()) >= low
            and float(position.max()) <= high
        ):
            return Status.FREE, jerk
        horizon = self._horizon
        normals = np.repeat(np.array([1.0, -1.0]), horizon).reshape(2, horizon, 1)
        offsets = np.repeat(np.array([low, -high]), horizon).reshape(2, horizon)
        planes = HalfPlanes(normals, offsets, np.ones((2, horizon)))
        found = self._upright.solve(start[:, 2:], optimum[:, :, 2:], planes, self._guess[:, 2:])
        return (Status.BRAKING, np.zeros(horizon)) if found is None else (Status.CONSTRAINED, found[:, 0])

    def _last_resort(
        self, start: Array, state: PeerState, peers: Sequence[PeerPlan], doubtful: Array | None
    ) -> tuple[Status, Array]:
        """What to do without a good solution: escape where measurements call for it, else the doubtful one, else stand."""
        velocity = escape(self._id, state, peers, self._limits, self._lead_s)
        if velocity is not None:
            return Status.ESCAPING, self._braking_jerk(start, velocity)
        return (Status.BRAKING, self._braking_jerk(start, (0.0, 0.0))) if doubtful is None else (Status.CONSTRAINED, doubtful)

    def _braking_jerk(self, start: Array, target: tuple[float, float]) -> Array:
        """Horizontal jerks (H, 2) that take the vehicle to this velocity as fast as the limits allow."""
        step, limit, rate = self._step_s, self._limits.acceleration_mps2, self._limits.jerk_mps3
        (vx, vy), (ax, ay) = start[1, :2].tolist(), start[2, :2].tolist()
        jerks = []
        for _ in range(self._horizon):
            wx, wy = (target[0] - vx) / _BRAKING_TIME_S, (target[1] - vy) / _BRAKING_TIME_S
            share = min(1.0, limit / max(hypot(wx, wy), 1e-9))
            jx, jy = (wx * share - ax) / step, (wy * share - ay) / step
            share = min(1.0, rate / max(hypot(jx, jy), 1e-9))
            jx, jy = jx * share, jy * share
            vx, vy = vx + step * (ax + 0.5 * step * jx), vy + step * (ay + 0.5 * step * jy)
            ax, ay = ax + step * jx, ay + step * jy
            jerks.append((jx, jy))
        return np.array(jerks)

    def _adopt(self, now_ns: int, start: Array, states: Array, jerk: Array, status: Status) -> TrackerPlan:
        full = np.concatenate((start[:, None], states), axis=1)
        positions, velocities, accelerations = full
        lists = full[:, :-1].tolist()
        self._guess[:-1] = jerk[1:]
        self._segments = list(zip(lists[0], lists[1], lists[2], jerk.tolist(), strict=True))
        self._end: list[float] = positions[-1].tolist()
        self._plan = TrackerPlan(now_ns, self._step_s, positions, velocities, accelerations, status)
        return self._plan
