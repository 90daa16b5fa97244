"""The frame of a new epoch by the continuity of the motion: a vehicle does not jump, whatever its localisation says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from agent.frames.transform import Transform
from agent.geometry import Quaternion, Vector3, yaw_of

# 1 sigma that the two poses and the motion between them add: position of each axis, m, and heading, rad.
ADDED_M, ADDED_RAD = 0.3, 0.03


def carried_on(
    mission_from_old: Transform,
    before: tuple[Vector3, Quaternion],
    velocity_mps: Vector3,
    after: tuple[Vector3, Quaternion],
    elapsed_s: float,
) -> Transform:
    """The frame of the epoch that begins with a jump, until the log yields a better one.

    Args:
        mission_from_old: frame of the epoch before.
        before: last position (m) and attitude in the old epoch.
        velocity_mps: velocity at that time, old epoch.
        after: first position (m) and attitude in the new epoch.
        elapsed_s: time between the two.
    """
    added = np.diag([ADDED_M**2, ADDED_M**2, ADDED_M**2, ADDED_RAD**2])
    then = mission_from_old @ Transform(yaw_of(before[1]), before[0], added)  # mission from body, levelled
    (x, y, z), (u, v, w) = then.translation, mission_from_old.rotate_direction(velocity_mps)
    now = replace(then, translation=(x + elapsed_s * u, y + elapsed_s * v, z + elapsed_s * w))
    return now @ Transform(yaw_of(after[1]), after[0]).inverse()
