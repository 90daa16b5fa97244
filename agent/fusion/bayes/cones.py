"""The likelihood of a Compton cone, given the angle between its axis and the direction to the source.

A coincidence of two clusters has up to two readings, as either cluster may be the recoil electron. Each reading has an axis n_k,
an opening angle theta_k, its 1-sigma error sigma_k and the probability p_k. With u the unit vector from the camera to the source,
the angular error of reading k is delta_k = angle(n_k, u) - theta_k. Its distribution is a mixture of a narrow and a wide
Gaussian. A fraction eps of the source's cones does not point to the source at all (scattered photons, chance coincidences). The
density of the cone per solid angle, relative to an isotropic one (1 / 4 pi), is

    rho(u) + eps,   rho(u) = sum_k sum_j L_kj,   L_kj = 2 (1 - eps) p_k f_j N(delta_k; 0, (c_j sigma_k)^2) / sin(theta_k).

The factor 2 / sin(theta) = 4 pi / (2 pi sin(theta)): a density over delta is spread over a ring of circumference
2 pi sin(theta). Values: eps = ``OUTLIER_FRACTION``, f = (0.7, 0.3), c = (0.95, 1.9); benchmarks/cone_quality.py compares the
mixture with simulated cones.
"""

from __future__ import annotations

from math import sin

import numpy as np
from msgspec import Struct

from radron.agent.fusion.observation import ConeObservation
from radron.agent.geometry import Array

OUTLIER_FRACTION = 0.08  # eps: share of the source's cones that do not point to it
_DENSITIES: Array = 2.0 * (1.0 - OUTLIER_FRACTION) * np.array([0.7, 0.3])  # 2 (1 - eps) f_j
_WIDTHS_SQUARED: Array = np.array([0.95, 1.9]) ** 2  # c_j^2
_MIN_CONE_SINE = 0.15  # floor of sin(theta): the ring approximation fails for narrow cones
_MIN_SIGMA_RAD = 0.02
_PER_TWO_PI = 0.5 / np.pi


class Orders(Struct, frozen=True, eq=False):
    """The K possible readings of a Compton cone, since either of its two clusters may be the recoil electron, prepared for the
    likelihood.

    axis: (K, 3) n_k, mission frame, from the absorbed photon to the recoil electron. theta_rad: (K,) opening angles. variance:
    (K, 2) (c_j sigma_k)^2, rad2, of the narrow and the wide part j of the angular error. weight: (K, 2) 2 (1 - eps) p_k f_j /
    sin(theta_k), with p_k the probability of the reading, f_j the share of the part, eps the fraction of outliers.
    """

    axis: Array
    theta_rad: Array
    variance: Array
    weight: Array

    @staticmethod
    def of(cone: ConeObservation) -> Orders:
        """Return the possible readings of a measured Compton cone, prepared for the likelihood."""
        table = np.array(
            [
                (
                    *r.axis,
                    r.theta_rad,
                    max(r.sigma_rad, _MIN_SIGMA_RAD) ** 2,
                    r.probability / max(sin(r.theta_rad), _MIN_CONE_SINE),
                )
                for r in cone.readings
            ]
        )
        return Orders(table[:, :3], table[:, 3], table[:, 4:5] * _WIDTHS_SQUARED, table[:, 5:] * _DENSITIES)

    def density(self, delta_rad: Array, variance: Array) -> tuple[Array, Array]:
        """Return the terms L_kj of a cone's density rho = sum L_kj in the source's direction, and the precisions 1 / V_kj, (...,
        K, 2) each.

        L_kj = 2 (1 - eps) p_k f_j N(delta_k; 0, V_kj) / sin(theta_k), V_kj = variance_k + (c_j sigma_k)^2, for the K readings k
        of the cone and the narrow and wide part j of the angular error. delta_rad: (..., K) angular error of each reading.
        variance: (..., K) variance of this error, rad2, by the uncertainty of source and camera.
        """
        precision = 1.0 / (variance[..., None] + self.variance)
        exponent = (-0.5 * delta_rad * delta_rad)[..., None] * precision
        return self.weight * np.exp(exponent) * np.sqrt(_PER_TWO_PI * precision), precision


def cone_likelihood(rate_ps: Array, directed: Array, background_ps: float) -> Array:
    """Return the likelihood of a registered cone, relative to H0 (no source):

        (R (rho + eps) + B) / (R + B),

    a mixture of the source's cones, of rate R, and isotropic background cones, of rate B; eps is the fraction of the source's
    cones that do not point to it. The likelihood is conditional on the cone's registration: its event counts in the exposure.

    rate_ps: (...) R, per second. directed: (...) rho, density of the cone in the source's direction. background_ps: B, per
    second.
    """
    return (rate_ps * (directed + OUTLIER_FRACTION) + background_ps) / (rate_ps + background_ps)
