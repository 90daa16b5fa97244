"""The likelihood of the counts: Poisson in every energy bin of every row, with the expectation of ``spectra``.

    M_re = T_r exp(g) [exp(v) B_e + sum_k S_ke(d_rk)],    d_rk = |x_k + b - p_r|

T_r live time, p_r the measured position, b and g the drone's position bias and the logarithm of its camera's sensitivity, v that
of the background. A row's log likelihood is weighted by 1 / (1 + eps^2 k_r), k_r its events: no row tells its rate better than to
the share eps, by which the model may be wrong.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from agent.fusion.sources.data import Rows
from agent.fusion.sources.solution import SOURCE, Solution
from agent.fusion.sources.spectra import NEAREST_M, PER_MM2, Spectra
from agent.geometry import Array
from agent.terrain.ground import Ground

_MODEL_ERROR = 0.05  # eps
_LEAST_SHARE = 0.3  # of the background: expectations are never less, where attenuation beyond the model's reach would make them


class CountModel:
    """The rows with all that does not depend on the sources."""

    def __init__(self, rows: Rows, spectra: Spectra, ground: Ground, drones: int) -> None:
        self._spectra, self._ground = spectra, ground
        self.place, self.counts = rows.place, rows.counts
        self.live_s = rows.live_s
        self.weight: Array = 1.0 / (1.0 + _MODEL_ERROR**2 * self.counts.sum(axis=1))
        self.drone = rows.drone
        edges = np.searchsorted(self.drone, np.arange(drones + 1))
        self._of_drone = [slice(start, end) for start, end in pairwise(edges.tolist())]

    def expected(self, solution: Solution) -> Array:
        """M, (R, BINS)."""
        near, far = self._spectra.templates(solution.scale, solution.scatter)
        total = least = self.background(solution)
        for k in range(len(solution)):
            strength, depth, *_ = self._arriving(solution, k)
            total = total + _mixed(strength, strength * depth, near[solution.nuclide[k]], far[solution.nuclide[k]])
        result: Array = np.maximum(total, _LEAST_SHARE * least)
        return result

    def background(self, solution: Solution) -> Array:
        """M without any source, (R, BINS)."""
        time = self.live_s * np.exp(solution.log_background + solution.bias[self.drone, 2])
        result: Array = time[:, None] * self._spectra.background_ps(solution.scale)
        return result

    def log_likelihood(self, expected: Array) -> float:
        """Without the terms that do not depend on the sources; expected: (R, BINS) M."""
        per_row = (self.counts * np.log(expected) - expected).sum(axis=1)
        return float(self.weight @ per_row)

    def scored(self, solution: Solution) -> tuple[float, Array, Array]:
        """Log likelihood; and by drone its gradient (V, p) and Fisher information (V, p, p) by the p = 3 K + 1 numbers of the
        sources and the background.
        """
        expected = self.expected(solution)
        jacobian = np.stack(list(self.derivatives(solution)))  # (p, R, BINS)
        excess = self.weight[:, None] * (self.counts / expected - 1.0)
        jacobian_scaled = jacobian * np.sqrt(self.weight[:, None] / expected)
        size = len(jacobian)
        gradients, informations = [], []
        for rows in self._of_drone:
            gradients.append(jacobian[:, rows].reshape(size, -1) @ excess[rows].ravel())
            part = jacobian_scaled[:, rows].reshape(size, -1)
            informations.append(part @ part.T)
        return self.log_likelihood(expected), np.array(gradients), np.array(informations)

    def scored_alone(self, solution: Solution, sources: Sequence[int], others: Array) -> tuple[float, Array, Array]:
        """Log likelihood, its gradient (p,) and Fisher information (p, p) by the p numbers of these sources alone, 3 of each,
        given ``others``, M without them (R, BINS).
        """
        jacobian = np.stack([part for k in sources for part in self._by_source(solution, k)])
        expected = np.maximum(others + jacobian[2::SOURCE].sum(axis=0), _LEAST_SHARE * others)
        size = len(jacobian)
        scaled = (jacobian * np.sqrt(self.weight[:, None] / expected)).reshape(size, -1)
        excess = self.weight[:, None] * (self.counts / expected - 1.0)
        return self.log_likelihood(expected), jacobian.reshape(size, -1) @ excess.ravel(), scaled @ scaled.T

    def derivatives(self, solution: Solution) -> Iterator[Array]:
        """(R, BINS) derivatives of M, in the order of ``Solution.vector``."""
        for k in range(len(solution)):
            yield from self._by_source(solution, k)
        yield self.background(solution)

    def _by_source(self, solution: Solution, k: int) -> Iterator[Array]:
        """(R, BINS) derivatives of M by x, y and log activity of source k; the last is what the source itself adds to M."""
        n = solution.nuclide[k]
        near, far = (of_all[n] for of_all in self._spectra.templates(solution.scale, solution.scatter))
        strength, depth, distance, east, north = self._arriving(solution, k)
        air = self._spectra.air_per_m[n]
        by_distance = _mixed(-strength * (2.0 / distance + air), -strength * (1.0 + depth) * air, near, far)
        yield by_distance * east[:, None]
        yield by_distance * north[:, None]
        yield _mixed(strength, strength * depth, near, far)

    def _arriving(self, solution: Solution, k: int) -> tuple[Array, Array, Array, Array, Array]:
        """(R,) each of source k: w times live time and sensitivity, mu d, d, and the derivatives of d by x and y."""
        distance, east, north = ways(self._ground, solution.place[k], self.place, solution.bias[self.drone])
        depth = self._spectra.air_per_m[solution.nuclide[k]] * distance
        logarithm = solution.log_activity[k] + solution.bias[self.drone, 2] - depth
        return PER_MM2 * self.live_s * np.exp(logarithm) / distance**2, depth, distance, east, north


def ways(ground: Ground, source: Array, places: Array, bias: Array) -> tuple[Array, Array, Array]:
    """Distances (N,) from measured places (N, 3) with biases (N, 3) to a source (2,), and their derivatives by its x and y."""
    x, y = source.tolist()
    rise = ground.slope(x, y)
    way = np.array((x, y, ground.height_m(x, y))) - places
    way[:, :2] += bias[:, :2]
    distance = np.maximum(np.sqrt((way**2).sum(axis=1)), NEAREST_M)
    return distance, (way[:, 0] + rise[0] * way[:, 2]) / distance, (way[:, 1] + rise[1] * way[:, 2]) / distance


def _mixed(first: Array, second: Array, near: Array, far: Array) -> Array:
    """first near' + second far', (R, BINS); first, second: (R,)."""
    result: Array = np.column_stack((first, second)) @ np.stack((near, far))
    return result


def parts_by_drone(drones: int, drone: NDArray[np.int64], gradient: Array) -> tuple[Array, Array]:
    """Sums (V, p) of gradients (N, p), and (V, p, p) of their outer products, by drone (N,)."""
    chosen = [gradient[drone == number] for number in range(drones)]
    return np.array([part.sum(axis=0) for part in chosen]), np.array([part.T @ part for part in chosen])
