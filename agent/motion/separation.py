"""Separation from other drones: half-planes for each step of a plan, from the peers' plans; as a last resort evasion by measured
positions.

Distances are horizontal: because of the downwash, drones do not pass above one another. Of two drones the one with the smaller id
has the right of way. It keeps 60 % of the margin, the other one all of it: if both evaded fully, they could meet again.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, hypot, inf, sin, sqrt

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from radron.agent.config.mission import LimitsConfig
from radron.agent.geometry import Array, Vector3
from radron.agent.motion.reference import PeerState

LEAST_MARGIN_M = 2.0  # between plans, in addition to the separation of vehicles: covers deviations from plans in a transient
_MARGIN_SIGMAS = 3.0  # multiple of the combined RMS deviation of both drones from their plans, for the same margin
DOUBT_SIGMAS = 2.0  # multiple of the 1 sigma of a position that separation and fence allow for
_RIGHT_OF_WAY = 0.6  # share of the margin kept by the drone with the right of way
_PASS_TURN = 0.35  # rad; the drone that gives way turns its half-planes by this, so that it passes on one side, not head-on


class PeerPlan(Struct, frozen=True):
    """Another drone as an obstacle: its planned or predicted path, in the frame in which this drone plans.

    positions: H positions (m), at stamp_ns, stamp_ns + step_s, ...; plain floats, because most plans are read once and found to
        be far away.
    sigma_m: 1 sigma of the other drone's position relative to this one.
    measured: its position and velocity by its newest pose, for evasion as a last resort; None without a recent pose.
    doubt_m: added even to the least separation of vehicles, because the position follows from estimated frames.
    deviation_m: its horizontal RMS deviation from its plans.
    blind: it does not know of this drone, or its agent does not steer it, so it never gives way.
    away: (H, 2) unit vectors, for a missing drone, else None. The positions are then points of a border beyond which it may be
        anywhere: at each step a line through the position, perpendicular to the vector, which points to this drone's side.
    radius_m: if the border is a circle, its radius, and the line is its tangent. Positive: the centre lies in the direction of
        ``away``, and this drone keeps inside. Negative: in the opposite direction, and this drone keeps outside. Infinite: a
        line.
    """

    id: str
    stamp_ns: int
    step_s: float
    positions: Sequence[Vector3]
    sigma_m: float = 0.0
    measured: PeerState | None = None
    doubt_m: float = 0.0
    deviation_m: float = 0.0
    blind: bool = False
    away: Array | None = None
    radius_m: float = inf

    @classmethod
    def from_pose(
        cls,
        peer: str,
        now_ns: int,
        state: PeerState,
        sigma_m: float = 0.0,
        doubt_m: float = 0.0,
        deviation_m: float = 0.0,
        horizon_s: float = 4.0,
        *,
        blind: bool = False,
    ) -> PeerPlan:
        """Return the obstacle of a drone at constant velocity from ``state`` on, for ``horizon_s``: it has published no plan, or
        does not follow it.
        """
        (x, y, z), (u, v, w) = state.position, state.velocity
        positions = [(x + t * u, y + t * v, z + t * w) for t in (state.age_s, state.age_s + horizon_s)]
        return cls(peer, now_ns, horizon_s, positions, sigma_m, state, doubt_m, deviation_m, blind)

    def ended(self, after_ns: int) -> PeerPlan:
        """Return the obstacle of a drone that stands where its plan is ``after_ns`` after the plan's stamp."""
        return replace(self, positions=[self.state(self.stamp_ns + after_ns).position])

    def goes_before(self, me: str) -> bool:
        """Return whether the other drone has the right of way over this drone, whose id is ``me``."""
        return self.blind or self.id < me

    def at(self, now_ns: int, after_s: float = 0.0) -> tuple[float, float]:
        """Return the other drone's planned horizontal position, ``after_s`` from now; extrapolated beyond the plan."""
        if len(self.positions) == 1:
            x, y, _ = self.positions[0]
            return x, y
        place = ((now_ns - self.stamp_ns) * 1e-9 + after_s) * (1.0 / self.step_s)
        first = min(max(int(place), 0), len(self.positions) - 2)
        share = place - first
        (x, y, _), (u, v, _) = self.positions[first], self.positions[first + 1]
        return x + share * (u - x), y + share * (v - y)

    def steps(self, now_ns: int, step_s: float, count: int) -> list[tuple[float, float]]:
        """Return the other drone's planned horizontal positions at 0, ``step_s``, ..., ``count * step_s`` from now: the same as
        by ``at``, but faster.
        """
        age_s = (now_ns - self.stamp_ns) * 1e-9
        if self.step_s != step_s or age_s < 0.0 or len(self.positions) == 1:
            return [self.at(now_ns, k * step_s) for k in range(count + 1)]
        # Equal steps: all positions lie at the same fraction between two points of the plan.
        place = age_s / step_s
        first = min(int(place), len(self.positions) - 2)
        share = place - first
        found = [
            (x + share * (u - x), y + share * (v - y))
            for (x, y, _), (u, v, _) in zip(self.positions[first:-1], self.positions[first + 1 : first + count + 2], strict=False)
        ]
        (x, y, _), (u, v, _) = self.positions[-2], self.positions[-1]
        (px, py), dx, dy = found[-1], u - x, v - y
        return found + [(px + k * dx, py + k * dy) for k in range(1, count + 2 - len(found))]

    def state(self, now_ns: int) -> PeerState:
        """Return the other drone's planned position and velocity now.

        They are better than a pose for spacing, because they are free of noise and of the vehicle's lag.
        """
        place = (now_ns - self.stamp_ns) * 1e-9 / self.step_s
        if len(self.positions) == 1:
            return PeerState(self.positions[0])
        index = min(max(int(place), 0), len(self.positions) - 2)
        (x, y, z), (u, v, w) = self.positions[index], self.positions[index + 1]
        dx, dy, dz, share, rate = u - x, v - y, w - z, place - index, 1.0 / self.step_s
        return PeerState((x + share * dx, y + share * dy, z + share * dz), (rate * dx, rate * dy, rate * dz))


def sampled(positions: Array, age_s: float, step_s: float, times: Array) -> Array:
    """Return the horizontal positions (T, 2) of a plan at ``times`` (T,) in s from now; extrapolated beyond its end.

    ``positions``: (H, 3) of the plan, ``step_s`` apart; ``age_s``: time since the first of them.
    """
    if len(positions) == 1:
        return np.repeat(positions[:, :2], len(times), axis=0)
    flat = positions[:, :2]
    place = (times + age_s) * (1.0 / step_s)
    index = np.minimum(np.maximum(place.astype(np.intp), 0), len(positions) - 2)
    share = (place - index)[:, None]
    begin = flat.take(index, axis=0)
    found: Array = begin + share * (flat.take(index + 1, axis=0) - begin)
    return found


def margin_m(own_m: float, peer_m: float) -> float:
    """Return the margin (m) that two plans keep in addition to the separation of vehicles.

    ``own_m``, ``peer_m``: RMS deviations of both drones from their plans, m.
    """
    return max(LEAST_MARGIN_M, _MARGIN_SIGMAS * hypot(own_m, peer_m))


def keep_away(me: str, peer: PeerPlan, separation_m: float, own_m: float = 0.0) -> float:
    """Return the distance (m) that this drone's plan keeps from the other drone's plan: separation, margin, and position
    uncertainty.

    ``me``: id of this drone; ``own_m``: its RMS deviation from its plans.
    """
    margin = margin_m(own_m, peer.deviation_m) * (1.0 if peer.goes_before(me) else _RIGHT_OF_WAY)
    return separation_m + margin + DOUBT_SIGMAS * peer.sigma_m


def half_planes(nominal: Array, here: tuple[float, float], other: Array, distance: float, yields: bool) -> tuple[Array, Array]:
    """Return half-planes n . p >= b that keep a plan away from another drone: normals n (H, 2) and offsets b (H,), one for each
    of H steps.

    Each is a tangent to the circle of radius ``distance`` around the other drone, towards this drone's nominal position. From
    step to step the normal turns by at most a right angle: otherwise a nominal path through the other drone would count as a path
    around it.

    Args:
        nominal: (H, 2), planned positions of this drone, which decide on which side it passes.
        here: its position now.
        other: (H + 1, 2), positions of the other drone now and at the steps.
        distance: to be kept, m.
        yields: this drone gives way.
    """
    relative = nominal - other[1:]
    normals = np.empty_like(relative)
    nx, ny = here[0] - float(other[0, 0]), here[1] - float(other[0, 1])
    size = hypot(nx, ny)
    nx, ny = (nx / size, ny / size) if size > 1e-6 else (1.0, 0.0)
    for step, (x, y) in enumerate(relative.tolist()):
        size = hypot(x, y)
        if size > 0.5 * distance and x * nx + y * ny > 0.0:
            nx, ny = x / size, y / size
        normals[step] = nx, ny
    if yields:
        c, s = cos(_PASS_TURN), sin(_PASS_TURN)
        normals = normals @ np.array([[c, s], [-s, c]])
    return normals, np.einsum("ij,ij->i", normals, other[1:]) + distance


def escape(
    me: str, state: PeerState, peers: Sequence[PeerPlan], limits: LimitsConfig, reaction_s: float
) -> tuple[float, float] | None:
    """Return a horizontal velocity (m/s) to fly at once, as a last resort against a collision; None if that is not needed.

    A collision threatens if this drone and another one, at their measured positions and velocities, would come closer than the
    separation even if both braked from now on. Then the drone with the right of way stops, and the other one flies away from it.
    Blind drones are not assumed to brake. ``reaction_s``: delay of the vehicle's reaction.
    """
    worst, answer = 0.0, None
    for peer in sorted(peers, key=lambda peer: peer.id):
        other = peer.measured
        if other is None:
            continue
        least = limits.separation_m + peer.doubt_m
        x = state.position[0] - other.position[0] - other.velocity[0] * other.age_s
        y = state.position[1] - other.position[1] - other.velocity[1] * other.age_s
        u, w = state.velocity[0] - other.velocity[0], state.velocity[1] - other.velocity[1]
        closing_squared = u * u + w * w
        brakes = 1.0 if peer.blind else 2.0
        braking_s = reaction_s + sqrt(closing_squared) / (2.0 * brakes * limits.acceleration_mps2)  # half the speed on average
        passing_s = min(max(0.0, -(x * u + y * w) / closing_squared), braking_s) if closing_squared > 1e-6 else 0.0
        miss = hypot(x + u * passing_s, y + w * passing_s)
        approaching = x * u + y * w < 0.0
        if miss - least < worst and (approaching or miss < 0.9 * least):
            worst = miss - least
            size = max(hypot(x, y), 1e-6)
            away = 2.0 if peer.goes_before(me) else 0.0
            answer = (away * x / size, away * y / size)
    return answer
