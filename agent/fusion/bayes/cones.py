"""How likely a cone is, given the angle between its axis and the source (reference, "Beyond").

Each of the cone's two orders has an angular error that is a mixture of a narrow and a wide Gaussian; some cones are none at all
(scattered photons, chance coincidences) and say nothing of the direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agent.frames.transform import Vector3
from agent.fusion.bayes.response import CONE_AREA_MM2, CONE_BACKGROUND_PS
from agent.fusion.observation import ConeObservation

Array = NDArray[np.float64]

SHARES: Array = np.array([0.77, 0.23])
WIDTHS: Array = np.array([0.9, 2.8])  # in units of the cone's own sigma
ASTRAY = 0.12  # share of the cones of a source that do not point to it
_LEAST_SINE = 0.15
_LEAST_SIGMA_RAD = 0.02


@dataclass(frozen=True, slots=True)
class Order:
    """One order of a cone: axis in the mission frame, opening angle, variances (2,) and log weights (2,) of its Gaussians."""

    axis: Vector3
    theta_rad: float
    variance: Array
    weight: Array


def orders_of(cone: ConeObservation) -> tuple[Order, ...]:
    """The orders that are possible."""
    return tuple(
        Order(
            reading.axis,
            reading.theta_rad,
            (max(reading.sigma_rad, _LEAST_SIGMA_RAD) * WIDTHS) ** 2,
            # The density per solid angle, relative to one that is the same in all directions.
            (1.0 - ASTRAY) * 2.0 * reading.probability * SHARES / max(math.sin(reading.theta_rad), _LEAST_SINE),
        )
        for reading in cone.readings
    )


def density(order: Order, delta_rad: Array, variance: Array) -> Array:
    """(..., 2): the two Gaussians' parts of an order's density at angular errors (...) whose own variance is (...)."""
    total = variance[..., None] + order.variance
    result: Array = order.weight * np.exp(-0.5 * (delta_rad * delta_rad)[..., None] / total) / np.sqrt(2.0 * np.pi * total)
    return result


def cone_rate(fluence_ps: Array) -> Array:
    """Cones per second from photons per mm2 and second."""
    return CONE_AREA_MM2 * fluence_ps


def cone_likelihood(rate_ps: Array, directed: Array) -> Array:
    """Likelihood of a cone, relative to a world without a source: of which source and background have their share.

    rate_ps (...): of the source's cones. directed (...): the orders' densities together.
    """
    return (rate_ps * (directed + ASTRAY) + CONE_BACKGROUND_PS) / (rate_ps + CONE_BACKGROUND_PS)
