"""The likelihood of the counts: Poisson in every energy bin of every row, with the expectation of ``spectra``.

    M_re = T_r exp(g) [exp(v) B_e + sum_k S_ke(d_rk, f_rk)],    d_rk = |x_k + b - p_r|

T_r live time, p_r the measured position, f_rk from the mean heading (the camera looks along the drone's x axis), b and g the
drone's position bias and the logarithm of its camera's sensitivity, v that of the background. A row's log likelihood is weighted
by 1 / (1 + eps^2 k_r), k_r its events: no row tells its rate better than to the share eps, by which the model may be wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from agent.fusion.sources.data import Rows
from agent.fusion.sources.solution import Solution
from agent.fusion.sources.spectra import MEAN_FACING, NEAREST_M, PER_MM2, Spectra
from agent.geometry import Array
from agent.terrain.ground import Ground
from protocol.spectrum import BINS

_MODEL_ERROR = 0.05  # eps
_EDGE_ON = 0.05  # f of a camera with its edge towards the source, which counts by its sides
_LEAST_SHARE = 0.3  # of the background: expectations are never less, where attenuation beyond the model's reach would make them


@dataclass(frozen=True)
class Part:
    """What some numbers of a solution change. of: which of the mixture's shapes, n of them. by: (n, numbers, R) derivatives of
    the shapes' strengths in each row.
    """

    of: slice
    by: Array


@dataclass(frozen=True)
class Mixture:
    """Spectra that are sums of few shapes (Q, BINS) of different strength in each row, (R, BINS) ``counts``. As all derivatives
    are such sums too, gradient and information follow from products of the few shapes.
    """

    shapes: Array
    parts: list[Part]
    counts: Array

    def plus(self, shape: Array, strength: Array) -> Mixture:
        """With a further shape (BINS,), and a number that is the logarithm of its strength (R,)."""
        part = Part(slice(len(self.shapes), len(self.shapes) + 1), strength[None, None])
        return Mixture(np.vstack((self.shapes, shape)), [*self.parts, part], self.counts + strength[:, None] * shape)

    @property
    def ends(self) -> list[int]:
        """Where the numbers of each part begin, and where the last ones end."""
        return [0, *accumulate(part.by.shape[1] for part in self.parts)]


class CountModel:
    """The rows with all that does not depend on the sources."""

    def __init__(self, rows: Rows, spectra: Spectra, ground: Ground, drones: int) -> None:
        self._spectra, self._ground = spectra, ground
        self.place, self.counts = rows.place, rows.counts
        self.live_s = rows.live_s
        self._facing = rows.facing
        self.weight: Array = 1.0 / (1.0 + _MODEL_ERROR**2 * self.counts.sum(axis=1))
        self.drone = rows.drone
        edges = np.searchsorted(self.drone, np.arange(drones + 1))
        self._of_drone = [slice(start, end) for start, end in pairwise(edges.tolist())]

    def expected(self, solution: Solution) -> Array:
        """M, (R, BINS)."""
        least = self.background(solution)
        sources = range(len(solution))
        return _floored(least + self._mixture(solution, sources).counts, least) if sources else least

    def background(self, solution: Solution) -> Array:
        """M without any source, (R, BINS)."""
        result: Array = self._background_s(solution)[:, None] * self._spectra.background_ps(solution.scale)
        return result

    def log_likelihood(self, expected: Array) -> float:
        """Without the terms that do not depend on the sources; expected: (R, BINS) M."""
        per_row = (self.counts * np.log(expected) - expected).sum(axis=1)
        return float(self.weight @ per_row)

    def scored(self, solution: Solution) -> tuple[float, Array, Array]:
        """Log likelihood; and by drone its gradient (V, p) and Fisher information (V, p, p) by the p = 3 K + 1 numbers of the
        sources and the background.
        """
        sources = self._mixture(solution, range(len(solution)))
        time, spectrum = self._background_s(solution), self._spectra.background_ps(solution.scale)
        least: Array = time[:, None] * spectrum
        expected = _floored(least + sources.counts, least)
        return self.log_likelihood(expected), *self._derived(sources.plus(spectrum, time), expected, self._of_drone)

    def scored_alone(self, solution: Solution, sources: Sequence[int], others: Array) -> tuple[float, Array, Array]:
        """Log likelihood, its gradient (p,) and Fisher information (p, p) by the p numbers of these sources alone, 3 of each,
        given ``others``, M without them (R, BINS).
        """
        mixture = self._mixture(solution, sources)
        expected = _floored(others + mixture.counts, others)
        gradients, informations = self._derived(mixture, expected, [slice(None)])
        return self.log_likelihood(expected), gradients[0], informations[0]

    def _background_s(self, solution: Solution) -> Array:
        """(R,) live times for the background, with its own strength and the cameras' sensitivities."""
        time: Array = self.live_s * np.exp(solution.log_background + solution.bias[self.drone, 2])
        return time

    def _derived(self, mixture: Mixture, expected: Array, groups: Sequence[slice]) -> tuple[Array, Array]:
        """Gradient (G, p) and Fisher information (G, p, p) of each group of rows, by the p numbers of a mixture."""
        weight = self.weight[:, None]
        towards = ((weight * (self.counts / expected - 1.0)) @ mixture.shapes.T).T  # (Q, R)
        between, pairs = _products(mixture.shapes, weight / expected)
        size = mixture.ends[-1]
        gradients, informations = np.empty((len(groups), size)), np.empty((len(groups), size, size))
        for place, part in enumerate(mixture.parts):
            own = slice(mixture.ends[place], mixture.ends[place + 1])
            by_row = (part.by * towards[part.of, None]).sum(axis=0)  # (numbers, R)
            for group, rows in enumerate(groups):
                gradients[group, own] = by_row[:, rows].sum(axis=1)
            for other in range(place + 1):
                theirs = slice(mixture.ends[other], mixture.ends[other + 1])
                before = mixture.parts[other]
                crossed = np.einsum("abr,bjr->ajr", between[pairs[part.of, before.of]], before.by)
                for group, rows in enumerate(groups):
                    block = (part.by[:, :, rows] @ crossed[:, :, rows].swapaxes(1, 2)).sum(axis=0)
                    informations[group, own, theirs] = block
                    informations[group, theirs, own] = block.T
        return gradients, informations

    def _mixture(self, solution: Solution, sources: Sequence[int]) -> Mixture:
        """What these sources add to M."""
        three = *self._spectra.templates(solution.scale, solution.scatter), self._spectra.facing(solution.scale)
        nuclides = sorted({solution.nuclide[k] for k in sources})
        shapes = np.array([part[n] for n in nuclides for part in three]).reshape(-1, BINS)
        parts = []
        for k in sources:
            first = 3 * nuclides.index(solution.nuclide[k])
            parts.append(Part(slice(first, first + 3), self._by_source(solution, k)))
        strengths = np.zeros((len(shapes), len(self.live_s)))
        for part in parts:
            strengths[part.of] += part.by[:, 2]
        return Mixture(shapes, parts, strengths.T @ shapes)

    def _by_source(self, solution: Solution, k: int) -> Array:
        """(3, 3, R) derivatives of the strengths of N, F and G by x, y and log activity of source k; the last: the strengths."""
        distance, east, north = ways(self._ground, solution.place[k], self.place, solution.bias[self.drone])
        air = self._spectra.air_per_m[solution.nuclide[k]]
        depth = air * distance
        logarithm = solution.log_activity[k] + solution.bias[self.drone, 2] - depth
        near = PER_MM2 * self.live_s * np.exp(logarithm) / distance**2
        near_by_distance, far_by_distance = -near * (2.0 / distance + air), -near * (1.0 + depth) * air
        facing, by_x, by_y = self._faced(solution, k, distance, (east, north))
        return np.array(
            (
                (near_by_distance * east, near_by_distance * north, near),
                (far_by_distance * east, far_by_distance * north, near * depth),
                (near_by_distance * east * facing + near * by_x, near_by_distance * north * facing + near * by_y, near * facing),
            )
        )

    def _faced(self, solution: Solution, k: int, distance: Array, by_place: tuple[Array, Array]) -> tuple[Array, Array, Array]:
        """(R,) each: f - ``MEAN_FACING`` of source k and its derivatives by x and y; ``by_place``: those of the distance.

        With the way (x, y, z) to the source, f^2 = (x^2 + y^2 + C (x^2 - y^2) + 2 S x y) / 2 d^2, of a level camera whose heading
        stays; C and S are the row's means.
        """
        x, y = (solution.place[k] + solution.bias[self.drone, :2] - self.place[:, :2]).T
        twice_cos, twice_sin = self._facing.T
        ahead, aside = x + twice_cos * x + twice_sin * y, y - twice_cos * y + twice_sin * x
        square = 0.5 * (x * ahead + y * aside) / distance**2
        facing = np.sqrt(np.maximum(square, 0.0) + _EDGE_ON**2)
        by_x, by_y = (
            (0.5 * along / distance**2 - square * by / distance) / facing
            for along, by in zip((ahead, aside), by_place, strict=True)
        )
        return facing - MEAN_FACING, by_x, by_y


def ways(ground: Ground, source: Array, places: Array, bias: Array) -> tuple[Array, Array, Array]:
    """Distances (N,) from measured places (N, 3) with biases (N, 3) to a source (2,), and their derivatives by its x and y."""
    x, y = source.tolist()
    rise = ground.slope(x, y)
    way = np.array((x, y, ground.height_m(x, y))) - places
    way[:, :2] += bias[:, :2]
    distance = np.maximum(np.sqrt((way**2).sum(axis=1)), NEAREST_M)
    return distance, (way[:, 0] + rise[0] * way[:, 2]) / distance, (way[:, 1] + rise[1] * way[:, 2]) / distance


def _floored(total: Array, least: Array) -> Array:
    """Expectations, nowhere less than a share of what is there without these sources."""
    result: Array = np.maximum(total, _LEAST_SHARE * least)
    return result


def _products(shapes: Array, weight: Array) -> tuple[Array, NDArray[np.int64]]:
    """(P, R) sums over the bins of the products of any two shapes (Q, BINS), times the weight (R, BINS); and which of them is of
    which two, (Q, Q).
    """
    first, second = np.tril_indices(len(shapes))
    pairs = np.empty((len(shapes), len(shapes)), np.int64)
    pairs[first, second] = pairs[second, first] = np.arange(len(first))
    return np.ascontiguousarray((weight @ (shapes[first] * shapes[second]).T).T), pairs


def parts_by_drone(drones: int, drone: NDArray[np.int64], gradient: Array) -> tuple[Array, Array]:
    """Sums (V, p) of gradients (N, p), and (V, p, p) of their outer products, by drone (N,)."""
    chosen = [gradient[drone == number] for number in range(drones)]
    return np.array([part.sum(axis=0) for part in chosen]), np.array([part.T @ part for part in chosen])
