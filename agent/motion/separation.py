"""Keeping apart: half-planes along the horizon from the peers' plans, and the last resort from where they really are.

Distances are horizontal: flying over one another is no way to pass, because of the downwash. Of two drones the one with the
smaller id has the right of way: the other keeps the whole margin, it keeps 60 % of it, so that they do not both dodge fully and
meet again.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, hypot, sin, sqrt

import numpy as np
from msgspec import Struct

from agent.config import LimitsConfig
from agent.motion.reference import Array, PeerState, Vector3

MARGIN_M = 2.0  # of plans beyond the separation of vehicles: what vehicles deviate from their plans in a transient
_SIGMAS = 2.0
_PASS_TURN = 0.35  # rad; the one that gives way sees the other turned by this, so it passes on one side and not head-on


class PeerPlan(Struct, frozen=True):
    """What another drone is going to do, already in my planning frame.

    positions: (H, 3) m, at stamp_ns, stamp_ns + step_s, ...; plain numbers, because most plans are looked at once and found to be
    far away. sigma_m: 1-sigma error of the other's position relative to mine.
    ``measured``: where it was by its own localisation, for the last resort; None where there is no fresh pose. doubt_m: by how
    much even the bare separation grows for it, because the frames are estimated by which it is placed.
    """

    id: str
    stamp_ns: int
    step_s: float
    positions: Sequence[Vector3]
    sigma_m: float = 0.0
    measured: PeerState | None = None
    doubt_m: float = 0.0

    @classmethod
    def from_pose(
        cls, peer: str, now_ns: int, state: PeerState, sigma_m: float = 0.0, doubt_m: float = 0.0, horizon_s: float = 4.0
    ) -> PeerPlan:
        """Straight on, for a drone that has sent no plan."""
        (x, y, z), (u, v, w) = state.position, state.velocity
        positions = [(x + t * u, y + t * v, z + t * w) for t in (state.age_s, state.age_s + horizon_s)]
        return cls(peer, now_ns, horizon_s, positions, sigma_m, state, doubt_m)

    def at(self, now_ns: int, times: Array) -> Array:
        """Horizontal positions (T, 2) at these seconds from now; beyond the plan it goes straight on."""
        return sampled(np.array(self.positions), (now_ns - self.stamp_ns) * 1e-9, self.step_s, times)

    def steps(self, now_ns: int, step_s: float, count: int) -> list[tuple[float, float]]:
        """Horizontal positions at 0, step_s, ..., count step_s from now, as ``at`` gives them."""
        age_s = (now_ns - self.stamp_ns) * 1e-9
        if self.step_s != step_s or age_s < 0.0 or len(self.positions) == 1:
            return [(x, y) for x, y in self.at(now_ns, step_s * np.arange(count + 1.0)).tolist()]
        # The plan has the same steps: all places lie by the same share between two of its points.
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
        """Where the plan has it now; better than a pose for spacing: free of noise and of the vehicle's lag."""
        place = (now_ns - self.stamp_ns) * 1e-9 / self.step_s
        if len(self.positions) == 1:
            return PeerState(self.positions[0])
        index = min(max(int(place), 0), len(self.positions) - 2)
        (x, y, z), (u, v, w) = self.positions[index], self.positions[index + 1]
        dx, dy, dz, share, rate = u - x, v - y, w - z, place - index, 1.0 / self.step_s
        return PeerState((x + share * dx, y + share * dy, z + share * dz), (rate * dx, rate * dy, rate * dz))


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
        braking_s = reaction_s + sqrt(closing_squared) / (4.0 * limits.acceleration_mps2)  # both brake; at half speed on average
        passing_s = min(max(0.0, -(x * u + y * w) / closing_squared), braking_s) if closing_squared > 1e-6 else 0.0
        miss = hypot(x + u * passing_s, y + w * passing_s)
        approaching = x * u + y * w < 0.0
        if miss - least < worst and (approaching or miss < 0.9 * least):
            worst = miss - least
            size = max(hypot(x, y), 1e-6)
            away = 2.0 if peer.id < me else 0.0
            answer = (away * x / size, away * y / size)
    return answer
