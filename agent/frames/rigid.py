"""The 6-DoF transform between two frames, with the covariance of its error.

Where frames are far enough apart their verticals differ, by 1 mrad in 6.4 km: that is what it takes more than ``Transform``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from agent.frames.transform import Transform, Vector3

Array = NDArray[np.float64]
_LEVEL = [0, 1, 2, 5]  # x, y, z and the turn about up


@dataclass(frozen=True, slots=True, eq=False)
class Rigid:
    """``a_from_b``: p_a = R p_b + t.

    rotation: R. translation: t (3,), metres, in frame a.
    covariance: (6, 6) over (delta m, theta rad) of the error, both along the axes of frame a: the true transform is
    (Exp(theta) R, t + delta), so that the error of a point is delta + theta x R p_b (Barfoot, "State Estimation for Robotics",
    Sec. 7.3, with delta not turned along). None means known exactly.
    """

    rotation: Rotation
    translation: Vector3 = (0.0, 0.0, 0.0)
    covariance: Array | None = None

    @classmethod
    def from_level(cls, transform: Transform, tilt_sigma_rad: float = 0.0) -> Rigid:
        """The same as a 4-DoF transform; ``tilt_sigma_rad``: 1 sigma of roll and of pitch, which that one takes for exact."""
        rotation = Rotation.from_euler("z", transform.yaw_rad)
        if transform.covariance is None and tilt_sigma_rad == 0.0:
            return cls(rotation, transform.translation)
        covariance = np.diag([0.0, 0.0, 0.0, tilt_sigma_rad**2, tilt_sigma_rad**2, 0.0])
        if transform.covariance is not None:
            covariance[np.ix_(_LEVEL, _LEVEL)] += transform.covariance
        return cls(rotation, transform.translation, covariance)

    def level(self) -> tuple[Transform, float]:
        """The nearest transform that keeps up up, and the angle (rad) by which it is wrong.

        The heading is the one that leaves the smallest turn, a tilt. A point p of frame b is then wrong by 2 sin(angle / 2) |p|
        at most; the translation is the same. The tilt's covariance is left out, its correlation with the rest too.
        """
        matrix = self.rotation.as_matrix()
        yaw_rad = math.atan2(matrix[1, 0] - matrix[0, 1], matrix[0, 0] + matrix[1, 1])
        tilt_rad = float((self.rotation * Rotation.from_euler("z", -yaw_rad)).magnitude())
        covariance = None if self.covariance is None else self.covariance[np.ix_(_LEVEL, _LEVEL)]
        return Transform(yaw_rad, self.translation, covariance), tilt_rad

    def apply(self, points: Array) -> Array:
        """Points (..., 3) of frame b, in frame a."""
        return self.rotate(points) + self.translation

    def rotate(self, directions: Array) -> Array:
        """Directions (or velocities) (..., 3) of frame b, in frame a."""
        turned: Array = np.asarray(directions) @ self.rotation.as_matrix().T
        return turned

    def point_covariance(self, point: Array) -> Array:
        """(3, 3): what the transform's error makes of a point (3,) of frame b, in frame a; to first order."""
        if self.covariance is None:
            return np.zeros((3, 3))
        jacobian = np.hstack((np.eye(3), -_cross(self.rotate(point))))
        covariance: Array = jacobian @ self.covariance @ jacobian.T
        return covariance

    def inverse(self) -> Rigid:
        """``b_from_a``; its covariance to first order."""
        back = self.rotation.inv()
        x, y, z = (-back.apply(self.translation)).tolist()
        if self.covariance is None:
            return Rigid(back, (x, y, z))
        turn = back.as_matrix()
        jacobian = np.zeros((6, 6))
        jacobian[:3, :3] = jacobian[3:, 3:] = -turn
        jacobian[:3, 3:] = -turn @ _cross(np.array(self.translation))
        return Rigid(back, (x, y, z), jacobian @ self.covariance @ jacobian.T)

    def __matmul__(self, other: Rigid) -> Rigid:
        """``a_from_b @ b_from_c`` is ``a_from_c``; the two errors count as independent, propagated to first order."""
        rotation = self.rotation * other.rotation
        moved = self.rotate(np.array(other.translation))
        x, y, z = (moved + self.translation).tolist()
        if self.covariance is None and other.covariance is None:
            return Rigid(rotation, (x, y, z))
        covariance = np.zeros((6, 6))
        if self.covariance is not None:
            outer = np.eye(6)
            outer[:3, 3:] = -_cross(moved)
            covariance += outer @ self.covariance @ outer.T
        if other.covariance is not None:
            inner = np.kron(np.eye(2), self.rotation.as_matrix())
            covariance += inner @ other.covariance @ inner.T
        return Rigid(rotation, (x, y, z), covariance)


def _cross(vector: Array) -> Array:
    """(3, 3) matrix of the product vector x ..."""
    x, y, z = vector.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
