"""The frame of a new epoch by the continuity of the motion: a vehicle does not jump, whatever its localisation says."""

from __future__ import annotations

from dataclasses import replace
from math import hypot, sqrt
from typing import Protocol

import numpy as np

from radron.agent.frames.transform import Transform
from radron.agent.geometry import Quaternion, Vector3, yaw_of

# 1 sigma of the assumptions on the two poses and the motion between them: position of each axis, and heading.
POSES_M, POSES_RAD = 0.3, 0.03  # the two poses; a filter that was reset slides for a moment
STAMPS_S = 0.02  # their stamps, which matter by the speed
VELOCITY_MPS, ACCELERATION_MPS2 = 0.2, 2.0  # half of the vehicles' limits
TURNING_RPS, TURNING_RPS2 = 0.1, 1.5  # a turn rate that is known, and its change
ANY_TURNING_RPS = 0.5  # an unknown turn rate
# Longest straight flight assumed of a vehicle without a link. After the loss of its agent it stops, this time ahead at its
# velocity. After the loss of the radio link alone it may have turned anywhere.
ONWARD_S = 1.5


class Posed(Protocol):
    """Telemetry, or the pose that a drone publishes: in the local frame of an epoch, with the localisation's own 1 sigma."""

    @property
    def stamp_ns(self) -> int:
        """Own time."""

    @property
    def position_m(self) -> Vector3:
        """Local frame."""

    @property
    def velocity_mps(self) -> Vector3:
        """Local frame."""

    @property
    def quaternion(self) -> Quaternion:
        """Local from body."""

    @property
    def position_sigma_m(self) -> float:
        """Of the horizontal distance."""

    @property
    def yaw_sigma_rad(self) -> float:
        """Of the heading."""


def carried_on(mission_from_old: Transform, before: Posed, after: Posed, turning_rps: float | None = None) -> Transform:
    """Return the frame of the epoch that begins with a jump, until the log yields a better one.

    Its covariance is that of the old frame at the place of the jump, plus that of the motion since then. The latter grows with
    time and speed. (For an exactly known frame it begins with that of the localisation.) Straight motion is assumed for at most
    ``ONWARD_S``. Otherwise a hovering vehicle whose agent stood still for 9 s was expected 9 m further on, and flown into.

    Args:
        mission_from_old: frame of the epoch before.
        before: the last pose in the old epoch.
        after: the first one in the new epoch.
        turning_rps: rate of the heading at ``before``; None if not known.
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
    """1 sigma of each axis of the position (m), and of the heading (rad), that two poses and the motion between them add."""
    elapsed_s, speed_mps = max(0, after.stamp_ns - before.stamp_ns) * 1e-9, hypot(*before.velocity_mps)
    half_s2, turning_rps = 0.5 * elapsed_s**2, ANY_TURNING_RPS if turning_rps is None else TURNING_RPS
    place_m = hypot(POSES_M, STAMPS_S * speed_mps, VELOCITY_MPS * elapsed_s, ACCELERATION_MPS2 * half_s2)
    return place_m, hypot(POSES_RAD, turning_rps * elapsed_s, TURNING_RPS2 * half_s2)
