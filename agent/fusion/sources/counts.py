"""The likelihood of the counts: Poisson in every energy bin of every row, with the expectation of ``spectra``.

    M_re = T_r exp(g) [exp(v) B_e + sum_k S_ke(d_rk)],    d_rk = |x_k + b - p_r|

T_r live time, p_r the measured position, b and g the drone's position bias and the logarithm of its camera's sensitivity, v that
of the background. A row's log likelihood is weighted by 1 / (1 + eps^2 k_r), k_r its events: no row tells its rate better than to
the share eps, by which the model may be wrong. That is with a clear view; what may hide the sources is in ``hidden``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from agent.fusion.sources.data import Rows
from agent.fusion.sources.hidden import Cells, Expected, Views
from agent.fusion.sources.solution import Solution
from agent.fusion.sources.spectra import NEAREST_M, PER_MM2, Spectra
from agent.geometry import Array, Vector3
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
        self._cells = Cells(rows)
        edges = np.searchsorted(self.drone, np.arange(drones + 1))
        self._of_drone = [slice(start, end) for start, end in pairwise(edges.tolist())]

    def expected(self, solution: Solution) -> Expected:
        """M, and the direct photons in it."""
        background = self.background(solution)
        clear, direct = background, np.zeros_like(background)
        for k in range(len(solution)):
            own, straight = self._added(solution, k)
            clear, direct = clear + own, direct + straight
        return _limited(clear, direct, background)

    def background(self, solution: Solution) -> Array:
        """M without any source, (R, BINS)."""
        time = self.live_s * np.exp(solution.log_background + solution.bias[self.drone, 2])
        result: Array = time[:, None] * self._spectra.background_ps(solution.scale)
        return result

    def camera_height_m(self, place: Array) -> float:
        """Height above the ground at a place (2,) from which most photons of a source there are counted: the mean of the rows'
        heights, weighted by live time over squared horizontal distance.
        """
        x, y = place.tolist()
        off = self.place[:, :2] - place
        weight = self.live_s / ((off**2).sum(axis=1) + NEAREST_M**2)
        return float(weight @ self.place[:, 2] / weight.sum()) - self._ground.height_m(x, y)

    def views(self, expected: Expected) -> Views:
        """What the counts say of what is expected of a solution."""
        return self._cells.views(self.counts, self.weight, expected)

    def log_likelihood(self, expected: Expected) -> float:
        """Without the terms that do not depend on the sources."""
        return self.views(expected).log_likelihood

    def scored(self, solution: Solution) -> tuple[float, Array, Array]:
        """Log likelihood; and by drone its gradient (V, p) and Fisher information (V, p, p) by the p = size K + 1 numbers of the
        sources and the background.
        """
        expected, background = self.expected(solution), self.background(solution)
        seen = self.views(expected)
        pulled, jacobian = self._seen(solution, range(len(solution)), seen)
        pulled = np.concatenate((pulled, np.vecdot(seen.excess, background)[None]))
        scaled = np.concatenate((jacobian, background[None])) * np.sqrt(seen.information[:, None] / expected.clear)
        gradients, informations = [], []
        for rows in self._of_drone:
            gradients.append(pulled[:, rows].sum(axis=1))
            part = scaled[:, rows].reshape(len(scaled), -1)
            informations.append(part @ part.T)
        return seen.log_likelihood, np.array(gradients), np.array(informations)

    def scored_alone(self, solution: Solution, sources: Sequence[int], others: Expected) -> tuple[float, Array, Array]:
        """Log likelihood, its gradient (p,) and Fisher information (p, p) by the p numbers of these sources alone,
        given ``others``, what is expected without them.
        """
        clear, direct = others.clear, others.direct
        for k in sources:
            own, straight = self._added(solution, k)
            clear, direct = clear + own, direct + straight
        expected = Expected(np.maximum(clear, others.least), direct, others.least)
        seen = self.views(expected)
        pulled, jacobian = self._seen(solution, sources, seen)
        scaled = (jacobian * np.sqrt(seen.information[:, None] / expected.clear)).reshape(len(jacobian), -1)
        return seen.log_likelihood, pulled.sum(axis=1), scaled @ scaled.T

    def _seen(self, solution: Solution, sources: Sequence[int], seen: Views) -> tuple[Array, Array]:
        """By the numbers of these sources: the rows' parts (p, R) of the gradient, and the derivatives (p, R, BINS) of M."""
        pulled, jacobian = [], []
        for k in sources:
            shapes = self._shapes(solution, k)
            pull = seen.excess @ shapes[:2].T - seen.blocked @ shapes[2:].T
            for coefficients in self._by_source(solution, k):
                pulled.append(np.vecdot(coefficients, pull))
                jacobian.append(coefficients @ shapes[:2])
        if not jacobian:
            return np.zeros((0, len(self.counts))), np.zeros((0, *self.counts.shape))
        return np.stack(pulled), np.stack(jacobian)

    def _shapes(self, solution: Solution, k: int) -> Array:
        """(4, BINS) of source k: N and F, and the direct photons in them."""
        n = solution.nuclide[k]
        clear = self._spectra.templates(solution.scale, solution.scatter)
        direct = self._spectra.direct_templates(solution.scale)
        return np.stack([of_all[n] for of_all in (*clear, *direct)])

    def _added(self, solution: Solution, k: int) -> tuple[Array, Array]:
        """(R, BINS) what source k adds to M, and to the direct photons in it."""
        shapes = self._shapes(solution, k)
        strength, depth, *_ = self._arriving(solution, k)
        coefficients = np.column_stack((strength, strength * depth))
        return coefficients @ shapes[:2], coefficients @ shapes[2:]

    def _by_source(self, solution: Solution, k: int) -> Iterator[Array]:
        """(R, 2) coefficients of N and F in the derivatives by x, y, log activity and, where it may be above the ground, height
        of source k.
        """
        strength, depth, distance, east, north, up = self._arriving(solution, k)
        air = self._spectra.air_per_m[solution.nuclide[k]]
        by_distance = np.column_stack((-strength * (2.0 / distance + air), -strength * (1.0 + depth) * air))
        yield by_distance * east[:, None]
        yield by_distance * north[:, None]
        yield np.column_stack((strength, strength * depth))
        if solution.height is not None:
            yield by_distance * up[:, None]

    def _arriving(self, solution: Solution, k: int) -> tuple[Array, Array, Array, Array, Array, Array]:
        """(R,) each of source k: w times live time and sensitivity, mu d, d, and the derivatives of d by x, y and height."""
        x, y = solution.place[k].tolist()
        distance, east, north, up = ways(self._ground, (x, y, solution.height_of(k)), self.place, solution.bias[self.drone])
        depth = self._spectra.air_per_m[solution.nuclide[k]] * distance
        logarithm = solution.log_activity[k] + solution.bias[self.drone, 2] - depth
        return PER_MM2 * self.live_s * np.exp(logarithm) / distance**2, depth, distance, east, north, up


def _limited(clear: Array, direct: Array, background: Array) -> Expected:
    """With expectations that are never less than a share of the background's."""
    least = _LEAST_SHARE * background
    return Expected(np.maximum(clear, least), direct, least)


def ways(ground: Ground, source: Vector3, places: Array, bias: Array) -> tuple[Array, Array, Array, Array]:
    """Distances (N,) from measured places (N, 3) with biases (N, 3) to a source (x, y, height above the ground), and their
    derivatives by its three numbers.
    """
    x, y, height = source
    rise = ground.slope(x, y)
    way = np.array((x, y, ground.height_m(x, y) + height)) - places
    way[:, :2] += bias[:, :2]
    distance = np.maximum(np.sqrt((way**2).sum(axis=1)), NEAREST_M)
    east, north, up = way.T
    return distance, (east + rise[0] * up) / distance, (north + rise[1] * up) / distance, up / distance


def parts_by_drone(drones: int, drone: NDArray[np.int64], gradient: Array) -> tuple[Array, Array]:
    """Sums (V, p) of gradients (N, p), and (V, p, p) of their outer products, by drone (N,)."""
    chosen = [gradient[drone == number] for number in range(drones)]
    return np.array([part.sum(axis=0) for part in chosen]), np.array([part.T @ part for part in chosen])
