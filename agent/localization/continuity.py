"""Local frame after a jump of the localisation, by the continuity of the motion: the vehicle itself has not jumped.

An epoch is the time between two jumps; the positions of each epoch belong to a local frame of its own.
"""

from __future__ import annotations

from dataclasses import replace
from math import hypot, sqrt
from typing import Protocol

import numpy as np

from radron.agent.frames.transform import Transform
from radron.agent.geometry import Quaternion, Vector3, yaw_of

# 1 sigma of the errors of the two poses before and after the jump, and of the motion between them, for each axis and the heading.
POSES_M, POSES_RAD = 0.3, 0.03  # of the two poses; a localisation filter that was reset still moves for a moment
STAMPS_S = 0.02  # of their stamps; times the speed
VELOCITY_MPS, ACCELERATION_MPS2 = 0.2, 2.0  # of the velocity; of the acceleration, half of the vehicles' limit
TURNING_RPS, TURNING_RPS2 = 0.1, 1.5  # of a known turn rate, and of its change
ANY_TURNING_RPS = 0.5  # of an unknown turn rate
# Longest straight flight that is assumed between the two poses. After the loss of its agent a vehicle stops, about so far ahead
# at its velocity. After the loss of the radio link alone it may have turned anywhere.
ONWARD_S = 1.5


class Posed(Protocol):
    """Telemetry, or a published pose: in the local frame of an epoch, with the errors (1 sigma) that the localisation states."""

    @property
    def stamp_ns(self) -> int:
        """Own time, ns."""

    @property
    def position_m(self) -> Vector3:
        """Position in the local frame."""

    @property
    def velocity_mps(self) -> Vector3:
        """Velocity in the local frame."""

    @property
    def quaternion(self) -> Quaternion:
        """Attitude, local from body."""

    @property
    def position_sigma_m(self) -> float:
        """1 sigma of the horizontal position."""

    @property
    def yaw_sigma_rad(self) -> float:
        """1 sigma of the heading."""


def carried_on(mission_from_old: Transform, before: Posed, after: Posed, turning_rps: float | None = None) -> Transform:
    """Return the frame (mission from local) of the epoch that begins with a jump, if the vehicle has moved on without a jump.

    It is used until the log gives a better one. The vehicle is assumed to have flown straight on at its last velocity, for at
    most ``ONWARD_S``: after a longer gap it has probably stopped. The covariance is that of the old frame at the place of the
    jump, plus that of the motion since then, which grows with time and speed. For an exactly known old frame, the errors stated
    by the localisation take the place of the former.

    Args:
        mission_from_old: frame of the old epoch.
        before: last pose in the old epoch.
        after: first pose in the new epoch.
        turning_rps: turn rate (rad/s) at ``before``; None if not known.
    """
    elapsed_s = max(0, after.stamp_ns - before.stamp_ns) * 1e-9
    axis_m, yaw_rad = spread(before, after, turning_rps)
    if mission_from_old.covariance is None:
        axis_m, yaw_rad = hypot(axis_m, before.position_sigma_m / sqrt(2.0)), hypot(yaw_rad, before.yaw_sigma_rad)
    added = np.diag([axis_m**2, axis_m**2, axis_m**2, yaw_rad**2])
    onward_s = min(elapsed_s, ONWARD_S)
    heading = yaw_of(before.quaternion) + onward_s * (turning_rps or 0.0)
    then = mission_from_old @ Transform(heading, before.position_m, added)  # mission from body, levelled
    (x, y, z), (u, v, w) = then.translation, mission_from_old.rotate_direction(before.velocity_mps)
    now = replace(then, translation=(x + onward_s * u, y + onward_s * v, z + onward_s * w))
    return now @ Transform(yaw_of(after.quaternion), after.position_m).inverse()


def spread(before: Posed, after: Posed, turning_rps: float | None = None) -> tuple[float, float]:
    """Return the 1 sigma of each axis of the position (m), and of the heading (rad), by the errors of the two poses, and by the
    unknown motion between them. Arguments as of ``carried_on``.
    """
    elapsed_s, speed_mps = max(0, after.stamp_ns - before.stamp_ns) * 1e-9, hypot(*before.velocity_mps)
    half_s2, turning_rps = 0.5 * elapsed_s**2, ANY_TURNING_RPS if turning_rps is None else TURNING_RPS
    place_m = hypot(POSES_M, STAMPS_S * speed_mps, VELOCITY_MPS * elapsed_s, ACCELERATION_MPS2 * half_s2)
    return place_m, hypot(POSES_RAD, turning_rps * elapsed_s, TURNING_RPS2 * half_s2)
