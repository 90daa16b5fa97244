"""The likelihood of the counts: Poisson in every energy bin of every row, with the expectation of ``spectra``.

    M_re = T_r exp(g) [exp(v) B_e + sum_k S_ke(d_rk, f_rk, h_rk)],    d_rk = |x_k + b - p_r|

T_r live time, p_r the measured position, f_rk from the mean heading (the camera looks along the drone's x axis), b and g the
drone's position bias and the logarithm of its camera's sensitivity, v the logarithm of the background's strength. A row's log
likelihood is weighted by 1 / (1 + eps^2 k_r), k_r its events. With a model error of the share eps, no row measures its rate
better than to this share. Near a source the counts change on the way of an exposure: there eps grows by about s^2 / d^2, s^2 the
mean squared distance from p_r. Known walls let a share of the photons from the source's side pass (``shades``); the share's
derivatives are left out. At the edges of their shadows eps grows, too. All this holds for an otherwise clear view; unknown walls
are in ``hidden``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np

from radron.agent.fusion.facing import MEAN_FACING, Facing
from radron.agent.fusion.sources.data import Rows
from radron.agent.fusion.sources.hidden import Cells, Expected, Views
from radron.agent.fusion.sources.shades import KnownWalls, Shades
from radron.agent.fusion.sources.shapes import Fields, Mixture, Part, derived
from radron.agent.fusion.sources.soil import BY_NUMBER, SOIL_SHAPES
from radron.agent.fusion.sources.solution import Solution
from radron.agent.fusion.sources.spectra import AIR, NEAR, NEAREST_M, PER_MM2, Spectra
from radron.agent.geometry import Array, Vector3
from radron.agent.terrain.ground import Ground
from radron.protocol.spectrum import BINS

_MODEL_ERROR = 0.05  # eps
_EDGE_ON = 0.05  # f of a camera with its edge towards the source, counting by its sides
_LEAST_PASSING = 1e-3
_SHAPES_KEPT = 8  # for the energy scales and excesses of scatter that a fit compares
_LEAST_SHARE = 0.3  # of the background: lower limit of expectations, where attenuation beyond the model's reach would decide

Derivatives = Callable[[], tuple[Array, Array]]  # a gradient and a Fisher information, computed only on demand


class CountModel:
    """The rows with every term that does not depend on the sources."""

    def __init__(self, rows: Rows, spectra: Spectra, ground: Ground, drones: int, walls: KnownWalls | None = None) -> None:
        self._spectra, self._ground = spectra, ground
        self._over_soil = spectra.soil is not None
        self._shades = Shades(walls, rows.place) if walls else None
        self.place, self.counts = rows.place, rows.counts
        self.live_s = rows.live_s
        self._facing = rows.facing
        self.weight: Array = 1.0 / (1.0 + _MODEL_ERROR**2 * self.counts.sum(axis=1))
        self.drone = rows.drone
        self._rows = rows
        edges = np.searchsorted(self.drone, np.arange(drones + 1))
        self._of_drone = [slice(start, end) for start, end in pairwise(edges.tolist())]

    @cached_property
    def _cells(self) -> Cells:
        return Cells(self._rows)

    def doubting(self, solution: Solution, sigma_m: Array) -> CountModel:
        """Return a model with less weight on rows near these sources or at the edges of their shadows.

        sigma_m: (K, 2) errors of the sources' places, metres.
        """
        if not len(solution):
            return self
        spread_m2, doubtful = self._rows.spread_m2, np.zeros(len(self.live_s))
        for k, n in enumerate(solution.nuclide):
            alone = self._mixture(solution, [k])
            distance = self._ways(solution, [k])[0][0]
            doubtful += (alone.strengths.T @ alone.shapes.sum(axis=1) * np.minimum(spread_m2 / distance**2, 1.0)) ** 2
            if self._shades is not None:
                share, sigma = self._shades.spread(n, self._source(solution, k), sigma_m[k])
                straight = alone.strengths.T @ alone.direct.sum(axis=1)
                doubtful += (straight * sigma / np.maximum(share, _LEAST_PASSING)) ** 2
        relative = doubtful / self.expected(solution).clear.sum(axis=1) ** 2
        model = copy(self)
        model.weight = 1.0 / (1.0 + (_MODEL_ERROR**2 + relative) * self.counts.sum(axis=1))
        return model

    def expected(self, solution: Solution) -> Expected:
        """Return M, and the direct photons in it."""
        background = self.background(solution)
        if not len(solution):
            return _limited(background, np.zeros_like(background), background)
        sources = self._mixture(solution, range(len(solution)))
        return _limited(background + sources.counts, sources.straight, background)

    def background(self, solution: Solution) -> Array:
        """Return M without any source, (R, BINS)."""
        result: Array = self._background_s(solution)[:, None] * self._background_ps(solution)
        return result

    def of_source(self, solution: Solution, k: int) -> Array:
        """Return the (R, BINS) counts that source k adds to M."""
        return self._mixture(solution, [k]).counts

    def camera_height_m(self, place: Array) -> float:
        """Return the camera height above the ground at a place (2,) from which most photons of a source there are counted. It is
        the mean of the rows' heights, weighted by live time over squared horizontal distance.
        """
        x, y = place.tolist()
        off = self.place[:, :2] - place
        weight = self.live_s / ((off**2).sum(axis=1) + NEAREST_M**2)
        return float(weight @ self.place[:, 2] / weight.sum()) - self._ground.height_m(x, y)

    def views(self, expected: Expected) -> Views:
        """Compare the counts with the expected counts of a solution."""
        return self._cells.views(self.counts, self.weight, expected)

    def log_likelihood(self, expected: Expected) -> float:
        """Return the log likelihood without the terms that do not depend on the sources."""
        return self.views(expected).log_likelihood

    def scored(self, solution: Solution) -> tuple[float, Derivatives]:
        """Return the log likelihood; and by drone its gradient (V, p) and Fisher information (V, p, p) by p numbers.

        The numbers are the sources', the background's and, over soil, the soil's: ``Solution.unbiased``.
        """
        sources = self._mixture(solution, range(len(solution)))
        time, spectrum = self._background_s(solution), self._background_ps(solution)
        background: Array = time[:, None] * spectrum
        expected = _limited(background + sources.counts, sources.straight, background)
        seen = self.views(expected)
        mixture = sources.plus(spectrum, time)

        def derivatives() -> tuple[Array, Array]:
            return derived(mixture, self._by_soil(sources, solution), expected, seen, self._of_drone)

        return seen.log_likelihood, derivatives

    def scored_alone(self, solution: Solution, sources: Sequence[int], others: Expected) -> tuple[float, Derivatives]:
        """Return the log likelihood, its gradient (p,) and Fisher information (p, p) by the p numbers of these sources alone.

        ``others``: expected counts without these sources.
        """
        mixture = self._mixture(solution, sources)
        clear = np.maximum(others.clear + mixture.counts, others.least)
        expected = Expected(clear, others.direct + mixture.straight, others.least)
        seen = self.views(expected)

        def derivatives() -> tuple[Array, Array]:
            (gradient,), (information,) = derived(mixture, None, expected, seen, [slice(None)])
            return gradient, information

        return seen.log_likelihood, derivatives

    def aside(self, solution: Solution, k: int) -> tuple[Array, Array, Array, Array]:
        """Return (R,) each, of source k: distances; f - ``MEAN_FACING``; h; effective live times.

        The live times include the sensitivity of the cameras and known walls, but neither air nor distance.
        """
        near, _, faced = self._unshaded(solution, [k])[0, :3, 2]
        distances, way, along = self._ways(solution, [k])
        distance, (steepness, _) = distances[0], self._depressed(solution, [k], distances, way, along)
        live: Array = self.live_s * np.exp(solution.bias[self.drone, 2])
        if self._shades is not None:
            live = live * self._shades.passing(solution.nuclide[k], self._source(solution, k))
        return distance, faced / near, steepness[0], live

    def derivatives(self, solution: Solution) -> Iterator[Array]:
        """Yield the (R, BINS) derivatives of M, in the order of ``Solution.vector``."""
        shapes, _ = self._shapes(solution)
        for n, one in zip(solution.nuclide, self._by_source(solution, range(len(solution))), strict=True):
            yield from (by.T @ shapes[n] for by in one.swapaxes(0, 1))
        yield self.background(solution)
        by_soil = self._by_soil(self._mixture(solution, range(len(solution))), solution)
        if by_soil is not None:
            yield from by_soil.whole

    def _by_soil(self, sources: Mixture, solution: Solution) -> Fields | None:
        """Return the derivatives of M by ``Solution.soil``; None over nothing. sources: of all sources of the solution."""
        soil = self._spectra.soil
        if soil is None:
            return None
        several = self._shapes(solution)[0].shape[1]
        of_soil = np.arange(len(sources.strengths)) % several >= several - SOIL_SHAPES
        scattered = sources.strengths[of_soil].T @ sources.shapes[of_soil]
        direct = BY_NUMBER[:, None] * scattered
        whole = direct.copy()
        relative, slope = soil.background(solution.soil)
        whole[1] += self.background(solution) * (slope / relative)
        return Fields(whole, direct)

    def _background_ps(self, solution: Solution) -> Array:
        return self._spectra.background_ps(solution.scale, solution.soil)

    def _background_s(self, solution: Solution) -> Array:
        """Return (R,) live times for the background, scaled by its strength and the cameras' sensitivities."""
        time: Array = self.live_s * np.exp(solution.log_background + solution.bias[self.drone, 2])
        return time

    def _mixture(self, solution: Solution, sources: Sequence[int]) -> Mixture:
        """Return the mixture that these sources add to M."""
        nuclides = sorted({solution.nuclide[k] for k in sources})
        shapes, direct = (each[nuclides] for each in self._shapes(solution))
        several = shapes.shape[1]
        parts = []
        strengths = np.zeros((several * len(nuclides), len(self.live_s)))
        for k, by in zip(sources, self._by_source(solution, sources), strict=True):
            place = nuclides.index(solution.nuclide[k])
            part = Part(slice(several * place, several * (place + 1)), by)
            parts.append(part)
            strengths[part.of] += part.by[:, 2]
        return Mixture(shapes.reshape(-1, BINS), direct.reshape(-1, BINS), parts, strengths)

    def _shapes(self, solution: Solution) -> tuple[Array, Array]:
        return _shapes(self._spectra, solution.scale, solution.scatter, tuple(solution.soil.tolist()), self._shades is not None)

    def _by_source(self, solution: Solution, sources: Sequence[int]) -> Array:
        """Return (K, Q, size, R) derivatives of the strengths of ``_shapes`` for each of K sources.

        The numbers are x, y, log activity and, with sources above the ground, height. Derivatives by log activity are the
        strengths.
        """
        by = self._unshaded(solution, sources)
        if self._shades is None:
            return by
        passing = [self._shades.passing(solution.nuclide[k], self._source(solution, k)) for k in sources]
        share = np.reshape(passing, (len(sources), 1, 1, len(self.live_s)))
        around = by[:, :2] if self._over_soil else by[:, :1] + AIR / NEAR * by[:, 1:2]
        return np.concatenate((around, share * by), axis=1)

    def _unshaded(self, solution: Solution, sources: Sequence[int]) -> Array:
        """Return (K, Q, size, R) as ``_by_source``, of ``Spectra.templates`` without walls."""
        distance, way, along = self._ways(solution, sources)
        air = self._spectra.air_per_m[[solution.nuclide[k] for k in sources]][:, None]
        depth = air * distance
        logarithm = solution.log_activity[list(sources), None] + solution.bias[self.drone, 2] - depth
        near = PER_MM2 * self.live_s * np.exp(logarithm) / distance**2
        facing, turns = self._faced(distance, way, along)
        nearer, farther = -near * (2.0 / distance + air), -near * (1.0 + depth) * air
        by = np.empty((len(distance), 6 if self._over_soil else 3, solution.size, distance.shape[1]))
        by[:, 0, 2], by[:, 1, 2], by[:, 2, 2] = near, near * depth, near * facing
        for number, one, turn in zip((0, 1, 3)[: solution.size - 1], along, turns, strict=False):
            by[:, 0, number] = nearer * one
            by[:, 1, number] = farther * one
            by[:, 2, number] = by[:, 0, number] * facing + near * turn
        if self._over_soil:
            steepness, falls = self._depressed(solution, sources, distance, way, along)
            by[:, 3] = by[:, 0]
            by[:, 4], by[:, 5] = by[:, 3] * steepness[:, None], by[:, 3] * (steepness * facing)[:, None]
            for number, fall, turn in zip((0, 1, 3)[: solution.size - 1], falls, turns, strict=False):
                by[:, 4, number] += near * fall
                by[:, 5, number] += near * (fall * facing + steepness * turn)
        return by

    def _source(self, solution: Solution, k: int) -> Vector3:
        """Return the place of source k, mission frame."""
        x, y = solution.place[k].tolist()
        return x, y, self._ground.height_m(x, y) + solution.height_of(k)

    def _ways(self, solution: Solution, sources: Sequence[int]) -> tuple[Array, Array, Array]:
        """Return distances (K, R) of K sources, the vectors (3, K, R) to them, and derivatives (3, K, R) of the distances by x, y
        and height of the sources.
        """
        at = solution.place[list(sources)]
        height = self._ground.heights_m(at) + [solution.height_of(k) for k in sources]
        way = np.column_stack((at, height)).T[:, :, None] - self.place.T[:, None]
        way[:2] += solution.bias[self.drone, :2].T[:, None]
        distance = np.maximum(np.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2), NEAREST_M)
        along = way / distance
        along[:2] += self._ground.slopes(at).T[:, :, None] * along[2]
        return distance, way, along

    def _depressed(
        self, solution: Solution, sources: Sequence[int], distance: Array, way: Array, along: Array
    ) -> tuple[Array, list[Array]]:
        """Return (K, R) each: h of K sources, 0 above the horizon, and its derivatives by x, y and height; arguments of
        ``_faced``.
        """
        steepness = np.maximum(-way[2] / distance, 0.0)
        east, north = self._ground.slopes(solution.place[list(sources)]).T[:, :, None]
        each = zip((east, north, 1.0), along, strict=True)
        return steepness, [np.where(steepness > 0.0, -(rise + steepness * by) / distance, 0.0) for rise, by in each]

    def _faced(self, distance: Array, way: Array, along: Array) -> tuple[Array, list[Array]]:
        """Return (K, R) each: f - ``MEAN_FACING`` of K sources, and its derivatives by x, y, height; arguments from ``_ways``."""
        (x, y, _), (twice_cos, twice_sin) = way, self._facing.T
        square, ahead, aside = faced = Facing.of(x, y, distance, twice_cos, twice_sin)
        facing, per_square, slope = faced.cosine(_EDGE_ON), 0.5 / distance**2, square / distance
        level: tuple[Array | float, ...] = (ahead, aside, 0.0)
        turns = [(per_square * one - slope * by) / facing for one, by in zip(level, along, strict=True)]
        return facing - MEAN_FACING, turns


@lru_cache(_SHAPES_KEPT)
def _shapes(spectra: Spectra, scale: float, scatter: float, soil: tuple[float, ...], shaded: bool) -> tuple[Array, Array]:
    """Return (N, Q, BINS) shapes of each nuclide, and the photons from the source's side in them.

    Without known walls: ``Spectra.templates``. With walls the scattered parts come first, then the direct templates: b Q,
    scattered nearby, and over soil a R, scattered by air. Over nothing, both scattered parts are alike.
    """
    of_soil = np.array(soil)
    whole, direct = spectra.templates(scale, scatter, of_soil), spectra.direct_templates(scale, of_soil)
    if not shaded:
        return whole, direct
    scattered = (whole - direct)[:, : 1 if spectra.soil is None else 2]
    return np.concatenate((scattered, direct), axis=1), np.concatenate((np.zeros_like(scattered), direct), axis=1)


def _limited(clear: Array, direct: Array, background: Array) -> Expected:
    """Limit expectations from below to a share of the background."""
    least = _LEAST_SHARE * background
    return Expected(np.maximum(clear, least), direct, least)
