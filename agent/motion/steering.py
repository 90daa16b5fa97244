"""Horizontal part of the tracker: it keeps each plan within the limits, apart from other drones, and inside the fence. If that
fails, it brakes or evades.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import StrEnum
from itertools import combinations
from math import hypot, inf, sqrt

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from radron.agent.config.drone import ResponseConfig
from radron.agent.config.mission import LimitsConfig
from radron.agent.geometry import Array
from radron.agent.motion.braking import brake
from radron.agent.motion.feedforward import reaction_s
from radron.agent.motion.goals import Piece
from radron.agent.motion.prediction import Prediction
from radron.agent.motion.qp import OCTAGON_INRADIUS, HalfPlanes, LimitedProblem
from radron.agent.motion.reference import PeerState
from radron.agent.motion.separation import DOUBT_SIGMAS, LEAST_MARGIN_M, PeerPlan, escape, half_planes, keep_away

_ROWS = 3  # half-planes per step in the constrained problem
_NEAR_M = 2.0  # half-planes nearer to the plan than this enter the problem
# If half-planes conflict, each is relaxed by so many metres per metre of slack (``HalfPlanes.yielding``); the distance from a
# peer with a link by one metre. For the fence, less with a larger position uncertainty of the drones nearby:
_FENCE_YIELDS = 1.0
# For a separation line: the drones on its other side cannot give way, so it is relaxed least of all, except with a large position
# uncertainty.
_LINE_YIELDS = 0.3
_FACING = -0.9  # cosine of the angle between the normals of two lines that face each other
# For a possible position of a lost peer: more than for a peer with a link. Otherwise a drone that is pushed away from such a
# position could turn back into the next drone on the circle, which could not brake in time. The value grows with the position
# uncertainty, unless this half-plane is the only one near the plan. Otherwise a drone on its way to its slot could cut the
# corner, and come too near to a landing one.
_UNHEARD_YIELDS = 2.0
# Time constant with which deviations of two drones from their plans are expected to decay, as exp(-(t / 3.4 s)^2). Measured: 0.93
# is left after a second, 0.70 after two, 0.44 after three, 0.26 after four (`python benchmarks/plan_return.py`). A faster decay
# would let two drones that pass each other at 8 m/s come nearer than their plans allow.
RETURN_S = 3.4

Peaks = list[list[float]]  # (4, 3): largest jerk, displacement, speed and acceleration of a plan along each axis


class Status(StrEnum):
    """How a plan was found: without an active limit, within limits, or by braking or evasion."""

    FREE = "free"  # no limit active
    CONSTRAINED = "constrained"  # solved within limits
    BRAKING = "braking"  # no solution: braking
    ESCAPING = "escaping"  # too close to another drone: braking or backing off


class Situation(Struct, frozen=True):
    """Inputs for one new plan of H steps.

    start: (3, 3), position, velocity, acceleration at which the plan begins. measured: the vehicle's measured state.
    response: its response to setpoints. previous: returns the positions (H, 2) of the previous plan at the steps.
    inside: returns a convex part of the fence, less the margin of plans.
    surely_inside: the unconstrained optimum surely lies inside the fence. guess: (H, 3), initial jerks for the solver.
    """

    now_ns: int
    start: Array
    measured: PeerState
    response: ResponseConfig
    previous: Callable[[], Array]
    inside: Callable[[], Piece]
    surely_inside: bool
    guess: Array


class _Neighbour(Struct, frozen=True):
    """Another drone near the plan, as an obstacle.

    positions: (H + 1, 2), now and at the steps. distance: to be kept by the plan, m. bare: least distance of the vehicles, m.
    is_blind: it gives no way. away: (H, 2), normals of the lines beyond which it may be; None if it is at the positions.
    yields: relaxation, m per metre of slack, as in ``HalfPlanes``; of all steps or of each, (H,).
    doubted_m: part of the distance for its position uncertainty.
    """

    positions: Array
    distance: float
    bare: float
    has_right_of_way: bool
    is_blind: bool
    away: Array | None = None
    yields: float | Array = 1.0
    doubted_m: float = 0.0


class Steering:
    """Horizontal part of each new plan: within the limits, apart from the other drones, inside the fence."""

    def __init__(self, limits: LimitsConfig, prediction: Prediction, step_s: float, horizon: int, drone_id: str) -> None:
        """Set up the optimisation. ``drone_id`` decides the right of way."""
        self._limits, self._prediction, self._id = limits, prediction, drone_id
        self._step_s, self._horizon = step_s, horizon
        flat = (limits.speed_mps, limits.acceleration_mps2, limits.jerk_mps3)
        self._problem = LimitedProblem(prediction, step_s, 2, flat, _ROWS)
        self._speed_squared = (limits.speed_mps * OCTAGON_INRADIUS) ** 2
        self._acceleration_squared = (limits.acceleration_mps2 * OCTAGON_INRADIUS) ** 2
        self._lasting: Array = np.linspace(1.0, 0.0, horizon)  # share of the present lack of distance at each step
        self._fading: list[float] = np.exp(-((step_s * np.arange(horizon + 1) / RETURN_S) ** 2)).tolist()

    def jerk(self, situation: Situation, optimum: Array, peaks: Peaks, peers: Sequence[PeerPlan]) -> tuple[Status, Array]:
        """Return the horizontal jerks (H, 2) of a new plan of H steps, and how they were found.

        The unconstrained optimum is taken if it keeps all limits; else the optimum within the limits, or without one braking or
        evasion. ``optimum``: (4, H, 3), jerks, positions, velocities, accelerations; ``peaks``: its largest values
        along each axis; ``peers``: the other drones as obstacles.
        """
        _, clear = self._neighbours(situation, optimum[1:2, :, :2], peers)
        clear = clear and self._within_limits(optimum[:, :, :2], peaks)
        if clear and situation.surely_inside:
            return Status.FREE, optimum[0, :, :2]
        normals, offsets = situation.inside()
        clearances = (optimum[1, :, :2] @ normals.T - offsets).min(axis=0)
        if clear and float(clearances.min()) >= 0.0:
            return Status.FREE, optimum[0, :, :2]
        # If a line, the fence or others push the drone aside, it may be far from the optimum, and from the obstacles there.
        previous = situation.previous()
        found, apart = self._constrained(situation, optimum, peers, (previous,), (normals, offsets))
        if found is not None and apart:
            return Status.CONSTRAINED, found
        away = escape(self._id, situation.measured, peers, self._limits, reaction_s(situation.response))
        if away is not None:
            return Status.ESCAPING, self._brake(situation, away)
        braking = self._brake(situation, (0.0, 0.0))
        if found is None:
            return Status.BRAKING, braking
        # A plan that leads through a gap beside a drone keeps to that gap, also if it becomes too narrow. Before it may be room.
        plans = (self._positions(optimum, braking), previous)
        other, apart = self._constrained(situation, optimum, peers, plans, (normals, offsets))
        return Status.CONSTRAINED, other if other is not None and apart else found

    def _constrained(
        self, situation: Situation, optimum: Array, peers: Sequence[PeerPlan], plans: Sequence[Array], fence: Piece
    ) -> tuple[Array | None, bool]:
        """Return the jerks (H, 2) of the solution within the limits (None without one), and whether it keeps the separation.

        It passes other drones on the same side as the first of ``plans``, (H, 2) each. Drones near any of these plans, or near
        the optimum, count. ``fence``: convex part of the fence that the plan stays inside.
        """
        (normals, offsets), nominal, free = fence, plans[0], optimum[1, :, :2]
        neighbours, _ = self._neighbours(situation, np.array((free, *plans)), peers)
        clearances = np.minimum((free @ normals.T - offsets).min(axis=0), (nominal @ normals.T - offsets).min(axis=0))
        near = clearances < _NEAR_M
        planes = self._half_planes(situation, free, nominal, neighbours, (normals[near], offsets[near]))
        found = self._problem.solve(situation.start[:, :2], optimum[:, :, :2], planes, situation.guess[:, :2])
        return found, found is not None and self._apart(self._positions(optimum, found), neighbours)

    def _positions(self, optimum: Array, jerks: Array) -> Array:
        """Return the positions (H, 2) of the plan with these jerks (H, 2)."""
        found: Array = optimum[1, :, :2] + self._prediction.position @ (jerks - optimum[0, :, :2])
        return found

    def _within_limits(self, optimum: Array, peaks: Peaks) -> bool:
        (jx, jy, _), _, (u, v, _), (ax, ay, _) = peaks
        if max(jx, jy) > self._limits.jerk_mps3:
            return False
        if u * u + v * v <= self._speed_squared and ax * ax + ay * ay <= self._acceleration_squared:
            return True
        speed, acceleration = np.einsum("skx,skx->sk", optimum[2:], optimum[2:]).max(axis=1).tolist()
        within: bool = speed <= self._speed_squared and acceleration <= self._acceleration_squared
        return within

    def _neighbours(self, situation: Situation, plans: Array, peers: Sequence[PeerPlan]) -> tuple[list[_Neighbour], bool]:
        """Return the drones near one of these plans, (P, H, 2), and whether all of these plans keep their distance from all
        drones.
        """
        neighbours: list[_Neighbour] = []
        clear = True
        if not peers:
            return neighbours, clear
        (x, y, _), (virtual_x, virtual_y, _), mine = situation.measured.position, situation.start[0].tolist(), plans.tolist()
        own_m = situation.response.tracking_error_m
        lines = []
        for peer in peers:
            theirs = self._corrected(peer, situation.now_ns, x - virtual_x, y - virtual_y)
            distance = keep_away(self._id, peer, self._limits.separation_m, own_m)
            doubted_m = _doubted_m(peer)
            if peer.away is not None:
                line_yields = max(_LINE_YIELDS, doubted_m / LEAST_MARGIN_M - 1.0)
                lines.append(_Neighbour(np.array(theirs), distance, 0.0, True, peer.blind, peer.away[1:], line_yields, doubted_m))
                continue
            apart = [
                (px - qx) ** 2 + (py - qy) ** 2 for plan in mine for (px, py), (qx, qy) in zip(plan, theirs[1:], strict=True)
            ]
            clearance = sqrt(min(apart)) - distance
            if clearance < _NEAR_M:
                bare = self._limits.separation_m + peer.doubt_m
                yields = self._yields(peer, distance - hypot(virtual_x - theirs[0][0], virtual_y - theirs[0][1]))
                goes_before = peer.goes_before(self._id)
                neighbours.append(_Neighbour(np.array(theirs), distance, bare, goes_before, peer.blind, None, yields, doubted_m))
                clear = clear and clearance >= 0.0
        for line in _with_room(lines, self._limits.separation_m):
            assert line.away is not None
            least_m = float(np.einsum("pkx,kx->pk", plans - line.positions[1:], line.away).min()) - line.distance
            neighbours += [line] if least_m < _NEAR_M else []
            clear = clear and least_m >= 0.0
        return neighbours, clear

    def _yields(self, peer: PeerPlan, lacking_m: float) -> float | Array:
        """Return by how many metres the distance from a drone is relaxed per metre of slack, for all steps, or for each (H,).

        ``lacking_m``: by how much the present distance is too small. If the part for the position uncertainty is missing, it can
        be gained only towards the end of the plan. Until then it is relaxed more than other distances and the fence, which would
        otherwise lose as much. From a drone that gives no way, it may not be gained for long.
        """
        doubted_m = _doubted_m(peer)
        if peer.blind:
            return max(_UNHEARD_YIELDS if peer.measured is None else 1.0, 1.0 + doubted_m / LEAST_MARGIN_M)
        lacking_m = min(lacking_m, doubted_m)
        return 1.0 if lacking_m <= 0.0 else 1.0 + (lacking_m / LEAST_MARGIN_M) * self._lasting

    def _corrected(self, peer: PeerPlan, now_ns: int, x: float, y: float) -> list[tuple[float, float]]:
        """Return a peer's planned positions (H + 1, 2), shifted by its present deviation from its plan less this drone's, (x, y).

        So the plans are kept apart as the vehicles will be. The shift decays over the steps, as deviations do.
        """
        positions = peer.steps(now_ns, self._step_s, self._horizon)
        dx, dy = -x, -y
        if peer.measured is not None:
            (px, py, _), (u, v, _), age = peer.measured.position, peer.measured.velocity, peer.measured.age_s
            dx += px + age * u - positions[0][0]
            dy += py + age * v - positions[0][1]
        return [(px + fading * dx, py + fading * dy) for (px, py), fading in zip(positions, self._fading, strict=True)]

    def _half_planes(
        self, situation: Situation, position: Array, nominal: Array, neighbours: Sequence[_Neighbour], fence: Piece
    ) -> HalfPlanes | None:
        """Return the half-planes of other drones and of the fence, at most three for each step; None if there are none.

        If there are more, the first one is that which the nominal plan (H, 2) violates most, and the next ones are those that
        this plan or the unconstrained optimum ``position`` (H, 2) violates most. The plan comes first because others may have
        pushed it far from the optimum. Then the optimum violates their half-planes more than the plan violates that of a drone in
        its way.
        """
        if not neighbours and len(fence[0]) == 0:
            return None
        horizon, count = self._horizon, max(_ROWS, len(neighbours) + len(fence[0]))
        here = (float(situation.start[0, 0]), float(situation.start[0, 1]))
        normals, offsets, yielding = np.zeros((count, horizon, 2)), np.full((count, horizon), -np.inf), np.ones((count, horizon))
        doubted_m = max((other.doubted_m for other in neighbours), default=0.0) if len(fence[0]) else 0.0
        is_only = len(neighbours) + len(fence[0]) == 1
        for row, other in enumerate(neighbours):
            # Near the fence there may be no room at the end of the plan, either: the greatest relaxation counts for all steps.
            yielding[row] = other.yields if len(fence[0]) == 0 else np.max(other.yields)
            if is_only and other.is_blind:
                yielding[row] = np.minimum(yielding[row], _UNHEARD_YIELDS)
            if other.away is not None:
                normals[row] = other.away
                offsets[row] = np.einsum("kx,kx->k", other.away, other.positions[1:]) + other.distance
                continue
            normals[row], offsets[row] = half_planes(nominal, here, other.positions, other.distance, other.has_right_of_way)
        fence_yields = _FENCE_YIELDS / (1.0 + doubted_m / LEAST_MARGIN_M)
        for row, (normal, offset) in enumerate(zip(*fence, strict=True), start=len(neighbours)):
            normals[row], offsets[row], yielding[row] = normal, offset, fence_yields
        if count > _ROWS:
            by_optimum, by_plan = (np.einsum("rkx,kx->rk", normals, plan) - offsets for plan in (position, nominal))
            slack, steps, first = np.minimum(by_optimum, by_plan), np.arange(horizon), by_plan.argmin(axis=0)
            slack[first, steps] = np.where(by_plan[first, steps] < 0.0, -np.inf, slack[first, steps])
            worst = np.argsort(slack, axis=0, kind="stable")[:_ROWS]
            normals, offsets, yielding = normals[worst, steps], offsets[worst, steps], yielding[worst, steps]
        return HalfPlanes(normals, offsets, yielding)

    def _apart(self, position: Array, neighbours: Sequence[_Neighbour]) -> bool:
        """Whether a solution (H, 2) keeps the least distance of vehicles from the other drones. A distance that is too small now,
        and only grows, counts as kept, because no solution can do better.
        """
        for other in neighbours:
            if other.away is not None:
                continue
            apart = position - other.positions[1:]
            squared = np.einsum("kx,kx->k", apart, apart)
            least = float(squared.min())
            if least < other.bare**2 and least < float(squared[0]):
                return False
        return True

    def _brake(self, situation: Situation, target: tuple[float, float]) -> Array:
        velocity, acceleration = situation.start[1:, :2].tolist()
        limits = (self._limits.acceleration_mps2, self._limits.jerk_mps3)
        return brake(velocity, acceleration, target, limits, self._step_s, self._horizon)


def _with_room(lines: Sequence[_Neighbour], separation_m: float) -> list[_Neighbour]:
    """Return the lines with their distances reduced so that there is room between two lines that face each other.

    Both then give up the same share of their distance beyond the separation. With full distances, a drone between two lines that
    diverge slightly would fly along them to where they are far enough apart, possibly far out of the area.
    """
    fitted = list(lines)
    for (first, _), (second, _) in combinations(enumerate(lines), 2):
        one, other = fitted[first], fitted[second]
        room_m = _room_m(one, other)
        wanted_m = one.distance + other.distance
        if room_m >= wanted_m:
            continue
        share = max(0.0, room_m - 2.0 * separation_m) / (wanted_m - 2.0 * separation_m)
        least_m = min(separation_m, 0.5 * room_m)
        for index, line in ((first, one), (second, other)):
            fitted[index] = replace(line, distance=least_m + share * (line.distance - separation_m))
    return fitted


def _room_m(one: _Neighbour, other: _Neighbour) -> float:
    """Return the least distance (m) between two lines that face each other; infinite if they do not, or have crossed."""
    assert one.away is not None
    assert other.away is not None
    facing = np.einsum("kx,kx->k", one.away, other.away) < _FACING
    between = other.positions[1:] - one.positions[1:]
    apart_m = 0.5 * np.einsum("kx,kx->k", one.away - other.away, between)
    apart_m = apart_m[facing & (apart_m > 0.0)]
    return float(apart_m.min()) if len(apart_m) else inf


def _doubted_m(peer: PeerPlan) -> float:
    """Return the part (m) of the distance from a drone that is kept for its position uncertainty, and not by ``doubt_m``."""
    return max(0.0, DOUBT_SIGMAS * peer.sigma_m - peer.doubt_m)
