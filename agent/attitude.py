"""Attitudes as quaternions (w, x, y, z): what they turn, and which heading they have."""

from __future__ import annotations

from math import atan2

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # w, x, y, z


def yaw_of(quaternion: Quaternion) -> float:
    """Heading of the body's x axis, rad."""
    w, x, y, z = quaternion
    return atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
