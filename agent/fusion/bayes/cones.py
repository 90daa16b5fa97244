"""How likely a cone is, given the angle between its axis and the source (reference, "Beyond").

Each of the cone's two orders has an angular error that is a mixture of a narrow and a wide Gaussian; some cones are none at all
(scattered photons, chance coincidences) and say nothing of the direction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agent.fusion.observation import ConeObservation

Array = NDArray[np.float64]

SHARES: Array = np.array([0.7, 0.3])
WIDTHS: Array = np.array([0.95, 1.9])  # in units of the cone's own sigma
ASTRAY = 0.08  # share of the cones of a source that do not point to it
_LEAST_SINE = 0.15
_LEAST_SIGMA_RAD = 0.02
_TWO_PI = 2.0 * np.pi


@dataclass(frozen=True, slots=True, eq=False)
class Orders:
    """The K possible orders of a cone: axes (K, 3) in the mission frame, opening angles (K,), variances (K, 2) and weights (K, 2)
    of their Gaussians.
    """

    axis: Array
    theta_rad: Array
    variance: Array
    weight: Array

    @staticmethod
    def of(cone: ConeObservation) -> Orders:
        """The orders of a cone that are possible."""
        readings = np.array([(*r.axis, r.theta_rad, r.sigma_rad, r.probability) for r in cone.readings])
        theta, sigma, probability = readings[:, 3], readings[:, 4:5], readings[:, 5]
        # The density per solid angle, relative to one that is the same in all directions.
        density = (1.0 - ASTRAY) * 2.0 * probability / np.maximum(np.sin(theta), _LEAST_SINE)
        return Orders(readings[:, :3], theta, (np.maximum(sigma, _LEAST_SIGMA_RAD) * WIDTHS) ** 2, density[:, None] * SHARES)

    def density(self, delta_rad: Array, variance: Array) -> tuple[Array, Array]:
        """The Gaussians' parts of the density, and their total variances, (..., K, 2) each, at angular errors (..., K) whose own
        variances are (..., K).
        """
        total = variance[..., None] + self.variance
        exponent = (delta_rad * delta_rad)[..., None] / total
        return self.weight * np.exp(-0.5 * exponent) / np.sqrt(_TWO_PI * total), total


def cone_likelihood(rate_ps: Array, directed: Array, background_ps: float) -> Array:
    """Likelihood of a cone, relative to a world without a source: of which source and background have their share.

    rate_ps (...): of the source's cones. directed (...): the orders' densities together.
    """
    return (rate_ps * (directed + ASTRAY) + background_ps) / (rate_ps + background_ps)
