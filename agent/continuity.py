"""A new frame by the continuity of the physical motion: a vehicle does not jump, whatever its localisation says."""

from __future__ import annotations

from math import remainder, tau

import numpy as np

from agent.attitude import Quaternion, Vector3, yaw_of
from agent.frames.transform import Transform

# 1 sigma of what the two poses and the motion between them add: position of each axis, m, and heading, rad.
ADDED_M, ADDED_RAD = 0.3, 0.03


def carried_on(
    mission_from_old: Transform,
    before: tuple[Vector3, Quaternion],
    velocity_mps: Vector3,
    after: tuple[Vector3, Quaternion],
    elapsed_s: float,
) -> Transform:
    """The frame of the epoch that has begun after a jump, until the log has a better one.

    Args:
        mission_from_old: of the epoch before.
        before: position and attitude in the old epoch, the last known.
        velocity_mps: by which it moved then, old epoch.
        after: position and attitude in the new epoch, the first known.
        elapsed_s: between the two.
    """
    (x, y, z), (u, v, w) = before[0], velocity_mps
    place = mission_from_old.apply_point((x + elapsed_s * u, y + elapsed_s * v, z + elapsed_s * w))
    yaw_rad = remainder(mission_from_old.yaw_rad + yaw_of(before[1]) - yaw_of(after[1]), tau)
    turned = Transform(yaw_rad).apply_point(after[0])
    translation = (place[0] - turned[0], place[1] - turned[1], place[2] - turned[2])
    old = mission_from_old.covariance if mission_from_old.covariance is not None else np.zeros((4, 4))
    # The error at the vehicle's place, carried to the new origin: d translation / d yaw = -(d R / d yaw) p.
    at_place = np.eye(4)
    ox, oy, _ = mission_from_old.rotate_direction(before[0])
    at_place[:2, 3] = -oy, ox
    to_origin = np.eye(4)
    to_origin[:2, 3] = turned[1], -turned[0]
    added = np.diag([ADDED_M**2, ADDED_M**2, ADDED_M**2, ADDED_RAD**2])
    return Transform(yaw_rad, translation, to_origin @ (at_place @ old @ at_place.T + added) @ to_origin.T)
