"""The likelihood of the counts: Poisson in every energy bin of every row, with the expectation of ``spectra``.

    M_re = T_r exp(g) [exp(v) B_e + sum_k S_ke(d_rk)],    d_rk = |x_k + b - p_r|

T_r live time, p_r the measured position, b and g the drone's position bias and the logarithm of its camera's sensitivity, v that
of the background. A row's log likelihood is weighted by 1 / (1 + eps^2 k_r), k_r its events: no row tells its rate better than to
the share eps, by which the model may be wrong.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from agent.fusion.sources.data import Rows
from agent.fusion.sources.solution import Solution
from agent.fusion.sources.spectra import NEAREST_M, PER_MM2, Spectra
from agent.geometry import Array, Vector3
from agent.terrain.ground import Ground
from protocol.spectrum import BINS

_MODEL_ERROR = 0.05  # eps
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

    def camera_height_m(self, place: Array) -> float:
        """Height above the ground at a place (2,) from which most photons of a source there are counted: the mean of the rows'
        heights, weighted by live time over squared horizontal distance.
        """
        x, y = place.tolist()
        off = self.place[:, :2] - place
        weight = self.live_s / ((off**2).sum(axis=1) + NEAREST_M**2)
        return float(weight @ self.place[:, 2] / weight.sum()) - self._ground.height_m(x, y)

    def log_likelihood(self, expected: Array) -> float:
        """Without the terms that do not depend on the sources; expected: (R, BINS) M."""
        per_row = (self.counts * np.log(expected) - expected).sum(axis=1)
        return float(self.weight @ per_row)

    def scored(self, solution: Solution) -> tuple[float, Array, Array]:
        """Log likelihood; and by drone its gradient (V, p) and Fisher information (V, p, p) by the p = size K + 1 numbers of the
        sources and the background.
        """
        sources = self._mixture(solution, range(len(solution)))
        time, spectrum = self._background_s(solution), self._spectra.background_ps(solution.scale)
        least: Array = time[:, None] * spectrum
        expected = _floored(least + sources.counts, least)
        return self.log_likelihood(expected), *self._derived(sources.plus(spectrum, time), expected, self._of_drone)

    def scored_alone(self, solution: Solution, sources: Sequence[int], others: Array) -> tuple[float, Array, Array]:
        """Log likelihood, its gradient (p,) and Fisher information (p, p) by the p numbers of these sources alone,
        given ``others``, M without them (R, BINS).
        """
        mixture = self._mixture(solution, sources)
        expected = _floored(others + mixture.counts, others)
        gradients, informations = self._derived(mixture, expected, [slice(None)])
        return self.log_likelihood(expected), gradients[0], informations[0]

    def derivatives(self, solution: Solution) -> Iterator[Array]:
        """(R, BINS) derivatives of M, in the order of ``Solution.vector``."""
        near, far = self._spectra.templates(solution.scale, solution.scatter)
        for k, n in enumerate(solution.nuclide):
            shapes = np.stack((near[n], far[n]))
            yield from (by.T @ shapes for by in self._by_source(solution, k).swapaxes(0, 1))
        yield self.background(solution)

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
        both = self._spectra.templates(solution.scale, solution.scatter)
        nuclides = sorted({solution.nuclide[k] for k in sources})
        shapes = np.array([part[n] for n in nuclides for part in both]).reshape(-1, BINS)
        parts = []
        for k in sources:
            first = 2 * nuclides.index(solution.nuclide[k])
            parts.append(Part(slice(first, first + 2), self._by_source(solution, k)))
        strengths = np.zeros((len(shapes), len(self.live_s)))
        for part in parts:
            strengths[part.of] += part.by[:, 2]
        return Mixture(shapes, parts, strengths.T @ shapes)

    def _by_source(self, solution: Solution, k: int) -> Array:
        """(2, size, R) derivatives of the strengths of N and F by x, y, log activity and, where it may be above the ground,
        height of source k; those by log activity are the strengths.
        """
        x, y = solution.place[k].tolist()
        distance, east, north, up = ways(self._ground, (x, y, solution.height_of(k)), self.place, solution.bias[self.drone])
        air = self._spectra.air_per_m[solution.nuclide[k]]
        depth = air * distance
        logarithm = solution.log_activity[k] + solution.bias[self.drone, 2] - depth
        near = PER_MM2 * self.live_s * np.exp(logarithm) / distance**2
        by_distance = -near * (2.0 / distance + air), -near * (1.0 + depth) * air
        upwards = () if solution.height is None else (up,)
        rows = [
            (change * east, change * north, strength, *(change * part for part in upwards))
            for strength, change in zip((near, near * depth), by_distance, strict=True)
        ]
        return np.array(rows)


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
