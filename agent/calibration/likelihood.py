"""Maximum of a likelihood, and the covariance by its curvature."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

from radron.agent.geometry import Array


def fitted(cost: Callable[[Array], float], start: Array, steps: Array) -> tuple[Array, Array]:
    """Find the K parameters with the largest likelihood, and their covariance.

    Args:
        cost: negative log likelihood of the parameters (K,).
        start: the parameters to begin with (K,).
        steps: about one standard deviation of each (K,): the unit of the search and of the derivatives.

    Returns:
        The best parameters (K,) and their covariance (K, K): the inverse of the Hessian there.
    """

    def scaled(x: Array) -> float:
        return cost(start + x * steps)

    found = minimize(scaled, np.zeros(len(start)), method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-4, "maxfev": 4000})
    found = minimize(scaled, found.x, method="BFGS")
    curvature = hessian(scaled, found.x)
    values, vectors = np.linalg.eigh(curvature)
    inverse = (vectors / np.maximum(values, 1e-6)) @ vectors.T  # a flat direction stays undetermined, not negative
    return start + found.x * steps, inverse * np.outer(steps, steps)


def hessian(cost: Callable[[Array], float], place: Array, step: float = 0.2) -> Array:
    """Return the second derivatives (K, K) of a function at a point (K,), by central differences."""
    count = len(place)
    moves = step * np.eye(count)
    middle = cost(place)
    result = np.empty((count, count))
    for i in range(count):
        result[i, i] = (cost(place + moves[i]) - 2.0 * middle + cost(place - moves[i])) / step**2
        for j in range(i):
            corners = [cost(place + a * moves[i] + b * moves[j]) for a in (1.0, -1.0) for b in (1.0, -1.0)]
            result[i, j] = result[j, i] = (corners[0] - corners[1] - corners[2] + corners[3]) / (4.0 * step**2)
    return result
