"""A new frame by the continuity of the physical motion: a vehicle does not jump, whatever its localisation says."""

from __future__ import annotations

from dataclasses import replace

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
    added = np.diag([ADDED_M**2, ADDED_M**2, ADDED_M**2, ADDED_RAD**2])
    then = mission_from_old @ Transform(yaw_of(before[1]), before[0], added)  # from the body, level
    (x, y, z), (u, v, w) = then.translation, mission_from_old.rotate_direction(velocity_mps)
    now = replace(then, translation=(x + elapsed_s * u, y + elapsed_s * v, z + elapsed_s * w))
    return now @ Transform(yaw_of(after[1]), after[0]).inverse()
