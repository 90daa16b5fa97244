"""How likely a cone is, given the angle between its axis and the source (reference, "Beyond").

Each of the cone's two orders has an angular error that is a mixture of a narrow and a wide Gaussian; some cones are none at all
(scattered photons, chance coincidences) and say nothing of the direction.
"""

from __future__ import annotations

from math import sin

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from agent.fusion.observation import ConeObservation

Array = NDArray[np.float64]

ASTRAY = 0.08  # share of the cones of a source that do not point to it
_DENSITIES: Array = 2.0 * (1.0 - ASTRAY) * np.array([0.7, 0.3])  # of the narrow and the wide Gaussian
_WIDTHS_SQUARED: Array = np.array([0.95, 1.9]) ** 2  # in units of the cone's own sigma
_LEAST_SINE = 0.15
_LEAST_SIGMA_RAD = 0.02
_PER_TWO_PI = 0.5 / np.pi


class Orders(Struct, frozen=True, eq=False):
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
        table = np.array(
            [
                # The density per solid angle, relative to one that is the same in all directions.
                (
                    *r.axis,
                    r.theta_rad,
                    max(r.sigma_rad, _LEAST_SIGMA_RAD) ** 2,
                    r.probability / max(sin(r.theta_rad), _LEAST_SINE),
                )
                for r in cone.readings
            ]
        )
        return Orders(table[:, :3], table[:, 3], table[:, 4:5] * _WIDTHS_SQUARED, table[:, 5:] * _DENSITIES)

    def density(self, delta_rad: Array, variance: Array) -> tuple[Array, Array]:
        """The Gaussians' parts of the density, and their precisions, (..., K, 2) each, at angular errors (..., K) whose own
        variances are (..., K).
        """
        precision = 1.0 / (variance[..., None] + self.variance)
        exponent = (-0.5 * delta_rad * delta_rad)[..., None] * precision
        return self.weight * np.exp(exponent) * np.sqrt(_PER_TWO_PI * precision), precision


def cone_likelihood(rate_ps: Array, directed: Array, background_ps: float) -> Array:
    """Likelihood of a cone, relative to a world without a source: of which source and background have their share.

    rate_ps (...): of the source's cones. directed (...): the orders' densities together.
    """
    return (rate_ps * (directed + ASTRAY) + background_ps) / (rate_ps + background_ps)
