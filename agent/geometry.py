"""Vector types, and attitudes as quaternions (w, x, y, z): heading, rotation of vectors, interpolation."""

from __future__ import annotations

from math import atan2

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Point2 = tuple[float, float]
Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # w, x, y, z


def yaw_of(quaternion: Quaternion) -> float:
    """Return the heading (rad, counter-clockwise from the world's x axis) of a body whose attitude is this quaternion."""
    w, x, y, z = quaternion
    return atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def turned(rotation: Quaternion, vector: Vector3) -> Vector3:
    """Return a vector rotated by a quaternion (w, x, y, z), which need not be of unit length."""
    w, x, y, z = rotation
    a, b, c = vector
    double = 2.0 / (w * w + x * x + y * y + z * z)
    tx, ty, tz = double * (y * c - z * b), double * (z * a - x * c), double * (x * b - y * a)
    return a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx


def blended(before: Quaternion, after: Quaternion, part: float) -> Quaternion:
    """Return the attitude between two attitudes, by normalised linear interpolation of their quaternions.

    part: 0 gives ``before``, 1 gives ``after``. The interpolation is accurate enough between poses 50 ms apart.
    """
    bw, bx, by, bz = before
    aw, ax, ay, az = after
    if bw * aw + bx * ax + by * ay + bz * az < 0.0:  # of the two quaternions of this attitude, the nearer one
        aw, ax, ay, az = -aw, -ax, -ay, -az
    w, x, y, z = bw + part * (aw - bw), bx + part * (ax - bx), by + part * (ay - by), bz + part * (az - bz)
    size = (w * w + x * x + y * y + z * z) ** 0.5
    return w / size, x / size, y / size, z / size
