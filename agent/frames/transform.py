"""The 4-DoF transform between two gravity-aligned ENU frames: yaw about up, then translation.

Roll and pitch need no transform: every vehicle measures up by itself, so local frames differ by heading and origin only
(the ``Frame`` message says the same). Single points and directions have a path in plain floats because they are moved once per
cone; arrays go through NumPy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Vector3 = tuple[float, float, float]
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Transform:
    """``a_from_b``: p_a = R(yaw_rad) p_b + translation.

    translation: metres, in frame a. yaw_rad: heading of b's x axis in a, counter-clockwise seen from above.
    covariance: (4, 4) over (x m, y m, z m, yaw rad) of the error of those four numbers; None means known exactly.
    """

    yaw_rad: float = 0.0
    translation: Vector3 = (0.0, 0.0, 0.0)
    covariance: Array | None = None
    _cos: float = field(init=False, repr=False)
    _sin: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_cos", math.cos(self.yaw_rad))
        object.__setattr__(self, "_sin", math.sin(self.yaw_rad))

    def rotate_direction(self, direction: Vector3) -> Vector3:
        """One direction of frame b, in frame a."""
        x, y, z = direction
        return (self._cos * x - self._sin * y, self._sin * x + self._cos * y, z)

    def apply_point(self, point: Vector3) -> Vector3:
        """One point of frame b, in frame a."""
        x, y, z = point
        tx, ty, tz = self.translation
        return (self._cos * x - self._sin * y + tx, self._sin * x + self._cos * y + ty, z + tz)

    def apply_points(self, points: Sequence[Vector3]) -> list[Vector3]:
        """A few points of frame b, in frame a."""
        c, s, (tx, ty, tz) = self._cos, self._sin, self.translation
        return [(c * x - s * y + tx, s * x + c * y + ty, z + tz) for x, y, z in points]

    def rotate(self, directions: Array) -> Array:
        """Directions (or velocities) (..., 3) of frame b, in frame a."""
        x, y = directions[..., 0], directions[..., 1]
        turned = np.array(directions, dtype=np.float64)
        turned[..., 0] = self._cos * x - self._sin * y
        turned[..., 1] = self._sin * x + self._cos * y
        return turned

    def apply(self, points: Array) -> Array:
        """Points (..., 3) of frame b, in frame a."""
        moved = self.rotate(points)
        moved += self.translation
        return moved

    def inverse(self) -> Transform:
        """``b_from_a``; its covariance to first order."""
        x, y, z = self.translation
        back = (-self._cos * x - self._sin * y, self._sin * x - self._cos * y, -z)
        if self.covariance is None:
            return Transform(-self.yaw_rad, back)
        jacobian = np.zeros((4, 4))
        jacobian[:3, :3] = -self.rotation_matrix().T
        # back = -R(-yaw) t, hence d back / d yaw:
        jacobian[:3, 3] = (self._sin * x - self._cos * y, self._cos * x + self._sin * y, 0.0)
        jacobian[3, 3] = -1.0
        return Transform(-self.yaw_rad, back, jacobian @ self.covariance @ jacobian.T)

    def __matmul__(self, other: Transform) -> Transform:
        """``a_from_b @ b_from_c`` is ``a_from_c``; the two errors count as independent, propagated to first order."""
        yaw_rad = math.remainder(self.yaw_rad + other.yaw_rad, math.tau)
        translation = self.apply_point(other.translation)
        if self.covariance is None and other.covariance is None:
            return Transform(yaw_rad, translation)
        covariance = np.zeros((4, 4))
        if self.covariance is not None:
            outer = np.eye(4)
            outer[:3, 3] = self._turned_per_yaw(other.translation)
            covariance += outer @ self.covariance @ outer.T
        if other.covariance is not None:
            inner = np.eye(4)
            inner[:3, :3] = self.rotation_matrix()
            covariance += inner @ other.covariance @ inner.T
        return Transform(yaw_rad, translation, covariance)

    def sigmas_at(self, point: Vector3) -> tuple[float, float]:
        """1 sigma of where a point of b lies in a (of the horizontal distance, m), and of the yaw (rad); 0 if known exactly."""
        if self.covariance is None:
            return 0.0, 0.0
        turned = np.zeros((2, 4))
        turned[0, 0] = turned[1, 1] = 1.0
        turned[:, 3] = self._turned_per_yaw(point)[:2]
        variance = float(np.trace(turned @ self.covariance @ turned.T))
        return math.sqrt(max(variance, 0.0)), math.sqrt(max(float(self.covariance[3, 3]), 0.0))

    def rotation_matrix(self) -> Array:
        """(3, 3) matrix that turns directions of frame b into frame a."""
        return np.array([[self._cos, -self._sin, 0.0], [self._sin, self._cos, 0.0], [0.0, 0.0, 1.0]])

    def _turned_per_yaw(self, vector: Vector3) -> Vector3:
        """Derivative of R(yaw) vector by yaw."""
        x, y, _ = vector
        return (-self._sin * x - self._cos * y, self._cos * x - self._sin * y, 0.0)
