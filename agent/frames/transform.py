"""The 4-DoF transform between two gravity-aligned ENU frames: yaw about up, then translation.

Roll and pitch need no transform: every vehicle measures the vertical itself, so local frames differ by heading and origin only
(as in the ``Frame`` message). Single points and directions are transformed in plain floats because that is done for every cone;
arrays use NumPy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from radron.agent.geometry import Array, Vector3


@dataclass(frozen=True, slots=True, eq=False)
class Transform:
    """The transform of points from frame b to frame a (``a_from_b``): a rotation about the vertical, then a translation.

    p_a = R(yaw_rad) p_b + translation. translation: metres, in frame a. yaw_rad: heading of b's x axis in a, counter-clockwise
    seen from above. covariance: (4, 4) of the errors of (x m, y m, z m, yaw rad); None: the transform is exact.
    """

    yaw_rad: float = 0.0
    translation: Vector3 = (0.0, 0.0, 0.0)
    covariance: Array | None = None
    _cos: float = field(init=False, repr=False)
    _sin: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_cos", math.cos(self.yaw_rad))
        object.__setattr__(self, "_sin", math.sin(self.yaw_rad))

    @property
    def covariance_rows(self) -> tuple[float, ...] | None:
        """The 16 numbers of the covariance by rows, as messages and files hold them; None if the transform is exact."""
        return None if self.covariance is None else tuple(self.covariance.ravel().tolist())

    def rotate_direction(self, direction: Vector3) -> Vector3:
        """Return a direction or velocity of frame b in the axes of frame a."""
        x, y, z = direction
        return (self._cos * x - self._sin * y, self._sin * x + self._cos * y, z)

    def apply_point(self, point: Vector3) -> Vector3:
        """Return a point of frame b in the coordinates of frame a (m)."""
        x, y, z = point
        tx, ty, tz = self.translation
        return (self._cos * x - self._sin * y + tx, self._sin * x + self._cos * y + ty, z + tz)

    def apply_points(self, points: Sequence[Vector3]) -> list[Vector3]:
        """Return points of frame b in the coordinates of frame a (m)."""
        c, s, (tx, ty, tz) = self._cos, self._sin, self.translation
        return [(c * x - s * y + tx, s * x + c * y + ty, z + tz) for x, y, z in points]

    def rotate(self, directions: Array) -> Array:
        """Return directions or velocities (..., 3) of frame b in the axes of frame a."""
        x, y = directions[..., 0], directions[..., 1]
        turned = np.array(directions, dtype=np.float64)
        turned[..., 0] = self._cos * x - self._sin * y
        turned[..., 1] = self._sin * x + self._cos * y
        return turned

    def apply(self, points: Array) -> Array:
        """Return points (..., 3) of frame b in the coordinates of frame a (m)."""
        moved = self.rotate(points)
        moved += self.translation
        return moved

    def inverse(self) -> Transform:
        """Return the opposite transform, ``b_from_a``, with its covariance to first order."""
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
        """Return the composed transform: ``a_from_b @ b_from_c`` is ``a_from_c``.

        The errors of the two are taken as independent, and propagated to first order.
        """
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

    def blurred(self, point: Vector3, variances: Sequence[float] | Array) -> Transform:
        """Return the transform with a larger covariance: the position and heading of a body at a point of frame b get further
        errors.

        point: position of the body in frame b (m). variances: (4,) of x, y, z (m^2) and yaw (rad^2), independent; the first two
        equal.
        """
        at_body = Transform(0.0, point)
        blurred = self @ at_body @ Transform(covariance=np.diag(variances)) @ at_body.inverse()
        return replace(self, covariance=blurred.covariance)

    def sigmas_at(self, point: Vector3) -> tuple[float, float]:
        """Return 1 sigma of the horizontal position in frame a (m) of a point of frame b, and 1 sigma of the yaw (rad); zeros if
        exact.
        """
        if self.covariance is None:
            return 0.0, 0.0
        u, v, _ = self._turned_per_yaw(point)
        (xx, _, _, x_yaw), (_, yy, _, y_yaw), _, (_, _, _, yaw) = self.covariance.tolist()
        variance = xx + yy + 2.0 * (u * x_yaw + v * y_yaw) + (u * u + v * v) * yaw
        return math.sqrt(max(variance, 0.0)), math.sqrt(max(yaw, 0.0))

    @property
    def yaw_sigma_rad(self) -> float:
        """1 sigma of the transform's yaw (rad); 0 if the transform is exact."""
        return 0.0 if self.covariance is None else math.sqrt(max(float(self.covariance[3, 3]), 0.0))

    def rotation_matrix(self) -> Array:
        """Return the matrix (3, 3) that rotates directions of frame b into the axes of frame a."""
        return np.array([[self._cos, -self._sin, 0.0], [self._sin, self._cos, 0.0], [0.0, 0.0, 1.0]])

    def _turned_per_yaw(self, vector: Vector3) -> Vector3:
        """Derivative of R(yaw) vector by yaw."""
        x, y, _ = vector
        return (-self._sin * x - self._cos * y, self._cos * x - self._sin * y, 0.0)


def same(a: Transform | None, b: Transform | None) -> bool:
    """Return whether two transforms have equal values; None (unknown) equals None."""
    if a is b:
        return True
    if a is None or b is None or (a.yaw_rad, a.translation) != (b.yaw_rad, b.translation):
        return False
    if a.covariance is None or b.covariance is None:
        return a.covariance is b.covariance
    return a.covariance.tobytes() == b.covariance.tobytes()
