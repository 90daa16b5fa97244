"""Encirclement: the arc of each drone around the source, evenly spaced from the others, without leader or negotiation.

Each drone computes its arc from the positions of all drones. There are two laws (``EncirclementConfig.law``):

- ``paper``: Sec. V-C of the paper. The arc begins a fixed angle beta away from the nearest neighbour by central angle. The law
  has no equilibrium: at even spacing beta still points away from whichever neighbour happens to be nearer. So the spacing
  oscillates around 2 pi / N, by the tracker's response to a step of beta between two plans.
- ``smooth``: a virtual structure of N slots, 2 pi / N apart, which rotates at v/r. Drones keep their order around the circle, and
  the phase of the structure is the least-squares fit to the angles of all drones. So all drones compute the same structure from
  the same positions, and each flies to its own slot. The velocity of the centre is fed forward.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import atan2, cos, hypot, pi, sin, sqrt

import numpy as np

from radron.agent.config.mission import EncirclementConfig, LimitsConfig
from radron.agent.geometry import Array, Vector3
from radron.agent.motion.reference import PeerState, Reference

# Angles are compared as predicted for this time ahead: a drone near the centre has a direction of motion, but no meaningful
# angle.
_LOOKAHEAD_S = 0.5
MARGIN_M = 2.5  # between neighbours on the smallest circle, beyond the separation
_CLOSING_SHARE = 0.5  # share of the acceleration limit for closing in; the rest is for the turn and for corrections
_AT_SLOT_M = 0.01  # a drone nearer to its slot than this is at the slot
_SPEED_SHARE = 0.85  # share of the speed limit for closing in and circling together


def wrapped(angle: float) -> float:
    """Return an angle (rad) wrapped to [-pi, pi)."""
    return (angle + pi) % (2.0 * pi) - pi


def minimum_radius(drones: int, separation_m: float) -> float:
    """Return the radius (m) of the smallest circle on which N evenly spaced drones are ``separation_m`` (d) apart: d / (2 sin(pi
    / N)).
    """
    return 0.0 if drones < 2 else separation_m / (2.0 * sin(pi / drones))


class Encirclement:
    """Flight of one drone on the circle around a centre (the estimated source), counter-clockwise and evenly spaced from the
    others.
    """

    def __init__(self, config: EncirclementConfig, limits: LimitsConfig, margin_m: float = MARGIN_M) -> None:
        """Set up the circle. ``margin_m``: distance between neighbours on the smallest circle, beyond ``limits.separation_m``."""
        self._config = config
        self._limits = limits
        self._spacing_m = limits.separation_m + margin_m
        self._times: Array = config.step_s * np.arange(config.steps + 1, dtype=np.float64)
        self._height_m = config.height_m
        self._circling = 0.0, 0.0  # radius and speed that the terms below were computed for
        self._terms: Array = np.ones((len(self._times), 4))  # (K + 1, 4): cosine and sine of the angle flown, time, 1
        self._terms[:, 2] = self._times

    def reference(
        self,
        me: PeerState,
        others: Mapping[str, PeerState],
        my_id: str,
        *,
        center: Vector3,
        center_velocity: Vector3 = (0.0, 0.0, 0.0),
        radius_m: float | None = None,
        height_m: float | None = None,
        doubt_m: float = 0.0,
        stands: bool = False,
    ) -> Reference:
        """Return the part of the circle to fly in the next seconds, by the configured law.

        Args:
            me: state of this drone; best that of its plan.
            others: states of the other drones on the circle, by id; best those of their plans.
            my_id: id of this drone; it decides the order of two drones at the same angle.
            center: the source estimate; its z is that of the ground, and the flight is at z + height_m.
            center_velocity: of the source estimate, m/s.
            radius_m, height_m: used instead of the configured ones. The radius is at least what the separation of all drones
            needs. doubt_m: added to that separation, for position uncertainty and deviations from plans. stands: the slots of the
            drones do not rotate; only with the law ``smooth``.
        """
        radius = max(radius_m or self._config.radius_m, minimum_radius(len(others) + 1, self._spacing_m + doubt_m))
        self._height_m = height_m or self._config.height_m
        if self._config.law == "paper":
            return self._paper(me, others, center, radius)
        offset = self._offset_from_slot(me, others, my_id, center, center_velocity)
        speed_mps = 0.0 if stands else self._config.speed_mps
        return self._approach(me, self._arc(_angle(me, center, 0.0) + offset, radius, center, center_velocity, speed_mps))

    def _paper(self, me: PeerState, others: Mapping[str, PeerState], center: Vector3, radius: float) -> Reference:
        """Return the reference by the law ``paper`` (Sec. V-C): t[k] = (r, phi + beta_i + k (v/r) dT), beta_i = -sgn(theta_i)
        beta; a single drone has no bias.

        theta_i: signed angle from this drone to its nearest neighbour by central angle. The paper prints k r v dT; the angular
        rate of a speed v on the radius r is v/r.
        """
        phi = _angle(me, center, 0.0)
        theta = min((wrapped(_angle(other, center, 0.0) - phi) for _, other in sorted(others.items())), key=abs, default=0.0)
        bias = -self._config.bias_rad if theta > 0.0 else self._config.bias_rad if theta < 0.0 else 0.0
        return self._arc(phi + bias, radius, center, (0.0, 0.0, 0.0), self._config.speed_mps)

    def _offset_from_slot(
        self, me: PeerState, others: Mapping[str, PeerState], my_id: str, center: Vector3, center_velocity: Vector3
    ) -> float:
        """Return the angle (rad) from this drone to its slot. Of two drones at the same angle, the smaller id comes first."""
        mine = _angle(me, center, _LOOKAHEAD_S, center_velocity)
        ahead = []  # angles from this drone to the others, in [0, 2 pi]: their order around the circle
        for name, other in others.items():
            gap = (_angle(other, center, _LOOKAHEAD_S, center_velocity) - mine) % (2.0 * pi)
            ahead.append((2.0 * pi if gap == 0.0 and name < my_id else gap, name))
        ahead.sort()
        # Least-squares phase: the mean over all drones of (angle - rank 2 pi / N); this drone has rank and angle 0.
        count = len(ahead) + 1
        return sum(gap - 2.0 * pi * rank / count for rank, (gap, _) in enumerate(ahead, start=1)) / count

    def _arc(self, angle: float, radius: float, center: Vector3, center_velocity: Vector3, speed: float) -> Reference:
        """Return the reference on an arc that begins now at this angle (rad), around a centre that moves on at its velocity."""
        if (radius, speed) != self._circling:
            self._circling, angles = (radius, speed), (speed / radius) * self._times
            self._terms[:, 0], self._terms[:, 1] = np.cos(angles), np.sin(angles)
        (x, y, z), (u, v, _), c, s = center, center_velocity, cos(angle), sin(angle)
        states = self._terms @ np.array(  # positions and velocities, linear in the four terms
            (
                (radius * c, radius * s, 0.0, -speed * s, speed * c, 0.0),
                (-radius * s, radius * c, 0.0, -speed * c, -speed * s, 0.0),
                (u, v, 0.0, 0.0, 0.0, 0.0),
                (x, y, z + self._height_m, u, v, 0.0),
            )
        )
        return Reference(states[:, :3], states[:, 3:], self._config.step_s)

    def _approach(self, me: PeerState, slot: Reference) -> Reference:
        """Return the reference ``slot`` with an initial way to it: the offset of the drone from its moving slot shrinks along a
        straight line as fast as the limits allow.

        The closing speed at a remaining offset s is min(v_c, sqrt(2 a_c s)), as of a vehicle that brakes in time.
        """
        dx, dy, dz = (a - b for a, b in zip(me.position, slot.positions[0].tolist(), strict=True))
        vx, vy, _ = slot.velocities[0].tolist()
        limits = self._limits
        offset = hypot(dx, dy)
        if offset > _AT_SLOT_M:
            dx, dy = dx / offset, dy / offset
            cap, recede = _SPEED_SHARE * limits.speed_mps, vx * dx + vy * dy  # closing in uses the speed that circling leaves
            closing = max(0.5, recede + sqrt(max(0.0, cap * cap - vx * vx - vy * vy + recede * recede)))
            remaining, speed = _stopping_profile(offset, closing, _CLOSING_SHARE * limits.acceleration_mps2, self._times)
            slot.positions[:, 0] += dx * remaining
            slot.positions[:, 1] += dy * remaining
            slot.velocities[:, 0] -= dx * speed
            slot.velocities[:, 1] -= dy * speed
        if abs(dz) > _AT_SLOT_M:
            remaining, speed = _stopping_profile(abs(dz), 0.8 * limits.climb_mps, 0.25 * limits.acceleration_mps2, self._times)
            slot.positions[:, 2] += (1.0 if dz > 0.0 else -1.0) * remaining
            slot.velocities[:, 2] -= (1.0 if dz > 0.0 else -1.0) * speed
        return slot


def _angle(drone: PeerState, center: Vector3, ahead_s: float, center_velocity: Vector3 = (0.0, 0.0, 0.0)) -> float:
    """Return the central angle (rad) of a drone on the circle, ``ahead_s`` from now."""
    time = drone.age_s + ahead_s
    return atan2(
        drone.position[1] + drone.velocity[1] * time - center[1] - center_velocity[1] * ahead_s,
        drone.position[0] + drone.velocity[0] * time - center[0] - center_velocity[0] * ahead_s,
    )


def _stopping_profile(distance: float, speed: float, deceleration: float, times: Array) -> tuple[Array, Array]:
    """Return remaining distances and speeds, (K + 1,) each, at ``times``, of a motion over ``distance`` at ``speed`` that brakes
    to a stop with ``deceleration``.
    """
    braking = speed * speed / (2.0 * deceleration)
    cruise = max(0.0, (distance - braking) / speed)
    start = sqrt(min(distance, braking))
    slope = sqrt(0.5 * deceleration)
    if cruise == 0.0:  # close enough to brake from the beginning: the usual case
        root = np.maximum(0.0, start - slope * times)
        return root * root, (2.0 * slope) * root
    root = np.maximum(0.0, start - slope * np.maximum(0.0, times - cruise))
    remaining = root * root + speed * np.maximum(0.0, cruise - times)
    return remaining, np.where(times < cruise, speed, 2.0 * slope * root)
