"""Direction of one distant source seen by a camera at rest: the likelihood of its cones over the sphere."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from radron.agent.detector.detection import ConeEvent

MAX_IMAGED_CONES = 5000  # more take time and improve less than the spacing of the fine grid
_GRID = 4000  # directions on the sphere, 3 degrees apart
_FINE_RAD = np.deg2rad(0.25)
_FINE_REACH = 24  # steps to each side
_BLOCK = 50  # cones per array operation
_MIN_IMAGE_EVIDENCE = 5.0  # natural logarithm of the Bayes factor


@dataclass(frozen=True, slots=True)
class Direction:
    """The best direction to a distant source (unit vector, camera frame), the RMS angle of its posterior, and the number of cones
    used.
    """

    unit: NDArray[np.float64]
    sigma_rad: float
    cones: int

    @property
    def polar_deg(self) -> float:
        """Angle (deg) between the direction to the source and the sensor's outward normal."""
        return float(np.rad2deg(np.arccos(np.clip(self.unit[2], -1.0, 1.0))))

    @property
    def azimuth_deg(self) -> float:
        """Azimuth (deg) of the direction in the sensor's plane, from x (along the rows) towards y."""
        return float(np.rad2deg(np.arctan2(self.unit[1], self.unit[0])))


class DirectionScan:
    """Collects Compton cones of a camera at rest, and finds the direction that is most likely for all of them.

    The likelihood of a cone for the direction u is 0.88 sum_o 2 pi_o p(delta_o) / max(sin theta_o, 0.15) + 0.12. The sum is over
    the two orders o of the photon's interactions; pi_o is the probability of the order, theta_o the cone's opening angle, delta_o
    the angle from u to the cone, and p a Gaussian core with a tail (estimation reference, "Beyond").
    """

    def __init__(self) -> None:
        self._axis: list[NDArray[np.float64]] = []
        self._numbers: list[NDArray[np.float64]] = []

    def add(self, cones: Iterable[ConeEvent]) -> None:
        """Add Compton cones, up to MAX_IMAGED_CONES in total; further cones are ignored."""
        for cone in cones:
            if len(self._axis) == MAX_IMAGED_CONES:
                return
            self._axis.append(cone.axis)
            self._numbers.append(np.stack((cone.theta_rad, cone.sigma_rad, cone.probability)))

    def best(self) -> Direction | None:
        """Return the most likely direction; None if the cones fit a single source no better than isotropic cones do.

        As the likelihood of a cone has the mean 1 over the sphere, the mean of the product over all cones is the Bayes factor of
        one distant source against isotropic cones.
        """
        if not self._axis:
            return None
        axis = np.stack(self._axis)
        theta, sigma, probability = np.stack(self._numbers, axis=1)
        coarse = _sphere(_GRID)
        log_likelihood = _log_likelihood(coarse, axis, theta, sigma, probability)
        if logsumexp(log_likelihood) - np.log(_GRID) < _MIN_IMAGE_EVIDENCE:
            return None
        peak = coarse[log_likelihood.argmax()]
        spread = _rms_angle(coarse, log_likelihood, peak)
        if spread < _FINE_RAD * _FINE_REACH / 2.0:  # the fine grid contains the posterior
            fine = _patch(peak)
            log_likelihood = _log_likelihood(fine, axis, theta, sigma, probability)
            peak = fine[log_likelihood.argmax()]
            spread = _rms_angle(fine, log_likelihood, peak)
        return Direction(peak, spread, len(axis))


def _log_likelihood(
    directions: NDArray[np.float64],
    axis: NDArray[np.float64],
    theta: NDArray[np.float64],
    sigma: NDArray[np.float64],
    probability: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Log likelihood (D,) of the directions (D, 3) for all cones, from axes (N, 2, 3) and the other arrays (N, 2)."""
    total = np.zeros(len(directions))
    for start in range(0, len(axis), _BLOCK):
        part = slice(start, start + _BLOCK)
        total += cone_log_likelihood(directions, axis[part], theta[part], sigma[part], probability[part]).sum(axis=0)
    return total


def cone_log_likelihood(
    directions: NDArray[np.float64],
    axis: NDArray[np.float64],
    theta: NDArray[np.float64],
    sigma: NDArray[np.float64],
    probability: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the log likelihood (N, D) of each of N cones for each of D source directions (D, 3).

    axis: (N, 2, 3) axes of the cones in both orders of the interactions. theta, sigma, probability: (N, 2) opening angle (rad),
    its 1 sigma (rad), and probability of each order.
    """
    delta = np.arccos(np.clip(axis @ directions.T, -1.0, 1.0)) - theta[:, :, None]  # (N, 2, D)
    pull = -0.5 * (delta / sigma[:, :, None]) ** 2
    shape = 0.77 / 0.9 * np.exp(pull / 0.9**2) + 0.23 / 2.8 * np.exp(pull / 2.8**2)
    scale = 2.0 * probability / (np.sqrt(2.0 * np.pi) * sigma * np.maximum(np.sin(theta), 0.15))
    found: NDArray[np.float64] = np.log(0.88 * (scale[:, :, None] * shape).sum(axis=1) + 0.12)
    return found


def _rms_angle(directions: NDArray[np.float64], log_likelihood: NDArray[np.float64], centre: NDArray[np.float64]) -> float:
    """RMS angle (rad) of the posterior over the directions from the centre."""
    angle = np.arccos(np.clip(directions @ centre, -1.0, 1.0))
    return float(np.sqrt(np.average(angle**2, weights=np.exp(log_likelihood - log_likelihood.max()))))


def _sphere(count: int) -> NDArray[np.float64]:
    """Nearly uniform directions (count, 3): a Fibonacci spiral."""
    i = np.arange(count) + 0.5
    z = 1.0 - 2.0 * i / count
    angle = np.pi * (1.0 + np.sqrt(5.0)) * i
    radius = np.sqrt(1.0 - z * z)
    return np.column_stack((radius * np.cos(angle), radius * np.sin(angle), z))


def _patch(centre: NDArray[np.float64]) -> NDArray[np.float64]:
    """A fine square grid of directions around one."""
    helper = np.eye(3)[np.abs(centre).argmin()]
    u = np.cross(centre, helper)
    u /= np.linalg.norm(u)
    v = np.cross(centre, u)
    steps = np.arange(-_FINE_REACH, _FINE_REACH + 1) * _FINE_RAD
    a, b = (grid.ravel()[:, None] for grid in np.meshgrid(steps, steps))
    patch = centre + a * u + b * v
    directions: NDArray[np.float64] = patch / np.linalg.norm(patch, axis=1, keepdims=True)
    return directions
