"""Braking: the stopping point of a drone, and the jerks that reach a given velocity as fast as the limits allow."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot

import numpy as np

from radron.agent.config.mission import LimitsConfig
from radron.agent.geometry import Array, Vector3
from radron.agent.motion.reference import PeerState

_TIME_S = 0.5  # time constant of the approach to the velocity once it is within the limits


def brake(
    velocity: Sequence[float],
    acceleration: Sequence[float],
    target: tuple[float, float],
    limits: tuple[float, float],
    step_s: float,
    horizon: int,
) -> Array:
    """Return the horizontal jerks (H, 2) in m/s3, for H steps (``horizon``), that bring a vehicle to the velocity ``target`` as
    fast as the limits allow.

    ``velocity``, ``acceleration``: (2,), at the start; ``limits``: of acceleration (m/s2) and jerk (m/s3).
    """
    (vx, vy), (ax, ay), (limit, rate) = velocity, acceleration, limits
    jerks = []
    for _ in range(horizon):
        wx, wy = (target[0] - vx) / _TIME_S, (target[1] - vy) / _TIME_S
        share = min(1.0, limit / max(hypot(wx, wy), 1e-9))
        jx, jy = (wx * share - ax) / step_s, (wy * share - ay) / step_s
        share = min(1.0, rate / max(hypot(jx, jy), 1e-9))
        jx, jy = jx * share, jy * share
        vx, vy = vx + step_s * (ax + 0.5 * step_s * jx), vy + step_s * (ay + 0.5 * step_s * jy)
        ax, ay = ax + step_s * jx, ay + step_s * jy
        jerks.append((jx, jy))
    return np.array(jerks)


def comes_to_rest(state: PeerState, limits: LimitsConfig) -> Vector3:
    """Return the stopping point of a drone that brakes from now on as fast as the limits of acceleration and jerk allow. Its
    height stays.
    """
    (x, y, z), (u, v, _) = state.position, state.velocity
    stopping_s = 0.5 * (hypot(u, v) / limits.acceleration_mps2 + limits.acceleration_mps2 / limits.jerk_mps3)
    return x + stopping_s * u, y + stopping_s * v, z
