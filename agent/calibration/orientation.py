"""The camera's orientation on the vehicle, from the cones of a source at known directions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from radron.agent.calibration.facing import Facing
from radron.agent.calibration.likelihood import hessian
from radron.agent.detector.detection import ConeEvent
from radron.agent.detector.imaging import cone_log_likelihood
from radron.agent.geometry import Array, Vector3

PRIOR_DEG = 10.0  # 1 sigma of each angle by which the camera may be turned against the drone file
MIN_CONES = 50  # at each facing
MAX_CONES = 1500  # at each facing: more improve less than the source's place is known
SYSTEMATIC_DEG = 0.3  # of the stated directions, and of the cones' kinematics
_STEP_RAD = np.deg2rad(1.0)


class Orientation(Struct, frozen=True):
    """The measured orientation of the camera on the vehicle.

    camera_rpy_deg: as in the drone file. turned_deg: against the assumed orientation, about the camera's axes; sigma_deg:
    standard deviations; cones: number of cones used, by direction of the source.
    """

    camera_rpy_deg: Vector3
    turned_deg: Vector3
    sigma_deg: Vector3
    cones: tuple[int, ...]


class _Cones:
    """The cones of one facing as arrays."""

    def __init__(self, cones: Sequence[ConeEvent], facing: Facing, camera_from_body: Array) -> None:
        cones = cones[:MAX_CONES]
        self._axis = np.stack([cone.axis for cone in cones])
        self._numbers = np.stack([[cone.theta_rad, cone.sigma_rad, cone.probability] for cone in cones], axis=1)
        self._assumed = camera_from_body @ np.array(facing.direction)

    def log_likelihood(self, turns: Array) -> Array:
        """(N, D) of the cones, where the camera is turned by rotation vectors (D, 3) in its own axes."""
        directions = Rotation.from_rotvec(turns).inv().apply(self._assumed)
        return cone_log_likelihood(np.atleast_2d(directions), self._axis, *self._numbers)


def fit_orientation(cones: list[list[ConeEvent]], facings: list[Facing], camera_rpy_deg: Vector3) -> Orientation | None:
    """Fit the camera's orientation on the vehicle to the cones of a source in known directions; None with too few cones in a
    direction.

    Maximum likelihood with a prior around ``camera_rpy_deg``, the orientation in the drone file. The covariance is that of
    estimating equations, H^-1 J H^-1 (Huber 1967), with H the curvature of the log likelihood and J the covariance of its
    gradient: cones with tails scatter more than their likelihood says.
    """
    counts = tuple(len(one) for one in cones)
    if len(cones) != len(facings) or min(counts, default=0) < MIN_CONES:
        return None
    body_from_camera = Rotation.from_euler("xyz", camera_rpy_deg, degrees=True)
    parts = [_Cones(one, facing, body_from_camera.as_matrix().T) for one, facing in zip(cones, facings, strict=True)]
    prior = np.eye(3) / np.deg2rad(PRIOR_DEG) ** 2

    def cost(turns: Array) -> Array:
        total = sum(part.log_likelihood(turns).sum(axis=0) for part in parts)
        result: Array = 0.5 * np.einsum("di,ij,dj->d", turns, prior, turns) - total
        return result

    steps = np.deg2rad(np.arange(-24.0, 25.0, 6.0))
    grid = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    start = grid[int(np.concatenate([cost(some) for some in np.array_split(grid, 12)]).argmin())]
    options = {"xatol": 1e-4, "fatol": 1e-3}
    best = minimize(lambda turn: float(cost(turn[None])[0]), start, method="Nelder-Mead", options=options).x

    curvature = hessian(lambda x: float(cost((best + x * _STEP_RAD)[None])[0]), np.zeros(3), 1.0) / _STEP_RAD**2
    scores = np.concatenate([_scores(part, best) for part in parts])
    inverse = np.linalg.inv(curvature)
    covariance = inverse @ (scores.T @ scores + prior) @ inverse
    sigma_deg = np.hypot(np.rad2deg(np.sqrt(np.diag(covariance))), SYSTEMATIC_DEG)
    rpy = (body_from_camera * Rotation.from_rotvec(best)).as_euler("xyz", degrees=True)
    turned_deg = np.rad2deg(best)
    return Orientation(_vector(rpy), _vector(turned_deg), _vector(sigma_deg), counts)


def _scores(part: _Cones, turn: Array) -> Array:
    """Derivatives (N, 3) of each cone's log likelihood."""
    moves = _STEP_RAD * np.eye(3)
    above, below = part.log_likelihood(turn + moves), part.log_likelihood(turn - moves)
    result: Array = (above - below) / (2.0 * _STEP_RAD)
    return result


def _vector(numbers: Array) -> Vector3:
    x, y, z = numbers.tolist()
    return (x, y, z)
