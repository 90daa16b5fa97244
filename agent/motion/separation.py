"""Keeping apart: half-planes along the horizon from the peers' plans, and the last resort from where they really are.

Distances are horizontal: flying over one another is no way to pass, because of the downwash. Of two drones the one with the
smaller id has the right of way: the other keeps the whole margin, it keeps 60 % of it, so that they do not both dodge fully and
meet again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, hypot, sin, sqrt

import numpy as np

from agent.config import LimitsConfig
from agent.motion.reference import Array, PeerState

MARGIN_M = 2.0  # of plans beyond the separation of vehicles: what vehicles deviate from their plans in a transient
_SIGMAS = 2.0
_PASS_TURN = 0.35  # rad; the one that gives way sees the other turned by this, so it passes on one side and not head-on


@dataclass(frozen=True, slots=True)
class PeerPlan:
    """What another drone is going to do, already in my planning frame.

    positions: (H, 3) m, at stamp_ns, stamp_ns + step_s, ...; sigma_m: 1-sigma error of the other's position relative to mine.
    ``measured``: where it was by its own localisation, for the last resort; None where there is no fresh pose.
    """

    id: str
    stamp_ns: int
    step_s: float
    positions: Array
    sigma_m: float = 0.0
    measured: PeerState | None = None

    @classmethod
    def from_pose(cls, peer: str, now_ns: int, state: PeerState, sigma_m: float = 0.0, horizon_s: float = 4.0) -> PeerPlan:
        """Straight on, for a drone that has sent no plan."""
        times = np.array([state.age_s, state.age_s + horizon_s])[:, None]
        positions = np.array(state.position) + times * np.array(state.velocity)
        return cls(peer, now_ns, horizon_s, positions, sigma_m, state)

    def at(self, now_ns: int, times: Array) -> Array:
        """Horizontal positions (T, 2) at these seconds from now; beyond the plan it goes straight on."""
        return sampled(self.positions, (now_ns - self.stamp_ns) * 1e-9, self.step_s, times)

    def state(self, now_ns: int) -> PeerState:
        """Where the plan has it now; better than a pose for spacing: free of noise and of the vehicle's lag."""
        place = (now_ns - self.stamp_ns) * 1e-9 / self.step_s
        if len(self.positions) == 1:
            return PeerState(tuple(self.positions[0].tolist()))
        index = min(max(int(place), 0), len(self.positions) - 2)
        first, second = self.positions[index].tolist(), self.positions[index + 1].tolist()
        x, y, z = (a + (place - index) * (b - a) for a, b in zip(first, second, strict=True))
        u, v, w = ((b - a) / self.step_s for a, b in zip(first, second, strict=True))
        return PeerState((x, y, z), (u, v, w))


def sampled(positions: Array, age_s: float, step_s: float, times: Array) -> Array:
    """Horizontal positions (T, 2) of a plan (H, 3) of this age, at these seconds from now; beyond its end it goes straight on."""
    if len(positions) == 1:
        return np.repeat(positions[:, :2], len(times), axis=0)
    flat = positions[:, :2]
    place = (times + age_s) * (1.0 / step_s)
    index = np.minimum(np.maximum(place.astype(np.intp), 0), len(positions) - 2)
    share = (place - index)[:, None]
    begin = flat.take(index, axis=0)
    found: Array = begin + share * (flat.take(index + 1, axis=0) - begin)
    return found


def keep_away(me: str, peer: PeerPlan, separation_m: float) -> float:
    """Distance that my plan keeps from this peer's."""
    margin = MARGIN_M if peer.id < me else 0.6 * MARGIN_M
    return separation_m + margin + _SIGMAS * peer.sigma_m


def half_planes(nominal: Array, here: tuple[float, float], other: Array, distance: float, yields: bool) -> tuple[Array, Array]:
    """Half-planes n . p >= b, tangents to the circles of radius ``distance`` around the other.

    nominal: (H, 2), where I would be; other: (H + 1, 2), where it will be now and at the steps. Returns normals (H, 2), offsets
    (H,). The normal turns with the nominal relative position but never by more than a right angle from step to step: a
    nominal path through the other must not be taken for one around it.
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
    """The last resort: horizontal velocity to take at once, or None while measured positions and velocities give no cause.

    Cause: if both braked from now on, going straight, we would still come nearer than the separation. Then both do, and the one
    that has to give way also backs off.
    """
    worst, answer = limits.separation_m, None
    for peer in sorted(peers, key=lambda peer: peer.id):
        other = peer.measured
        if other is None:
            continue
        x = state.position[0] - other.position[0] - other.velocity[0] * other.age_s
        y = state.position[1] - other.position[1] - other.velocity[1] * other.age_s
        u, w = state.velocity[0] - other.velocity[0], state.velocity[1] - other.velocity[1]
        closing_squared = u * u + w * w
        braking_s = reaction_s + sqrt(closing_squared) / (4.0 * limits.acceleration_mps2)  # both brake; at half speed on average
        passing_s = min(max(0.0, -(x * u + y * w) / closing_squared), braking_s) if closing_squared > 1e-6 else 0.0
        miss = hypot(x + u * passing_s, y + w * passing_s)
        approaching = x * u + y * w < 0.0
        if miss < worst and (approaching or miss < 0.9 * limits.separation_m):
            worst = miss
            size = max(hypot(x, y), 1e-6)
            away = 2.0 if peer.id < me else 0.0
            answer = (away * x / size, away * y / size)
    return answer
