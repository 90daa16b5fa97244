"""Search for a further source: a score test on a grid of places, for every nuclide, and the fit of a single source."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from shapely import Polygon, contains_xy

from radron.agent.fusion.sources.counts import CountModel
from radron.agent.fusion.sources.data import Rows
from radron.agent.fusion.sources.soil import Sight
from radron.agent.fusion.sources.solution import Solution
from radron.agent.fusion.sources.spectra import NEAREST_M, PER_MM2, Spectra
from radron.agent.geometry import Array
from radron.agent.terrain.ground import Ground

_LEAST_GAIN = 6.0  # of log likelihood by the score test; the following fit usually gains more
_MOST = 6  # fitted candidates
_APART_M = 5.0  # of two candidates of the same nuclide
_GRID_M, _MOST_PLACES = 2.5, 2500  # grid of the births
_LEVEL_M = 5.0  # between heights above the ground
_AIR_PER_M = 0.009  # in the score test, for all nuclides


@dataclass(frozen=True)
class Candidate:
    """A source to add. place: (2,) metres; height: above the ground, metres. gain: estimated gain of log likelihood."""

    nuclide: int
    place: Array
    height: float
    log_activity: float
    gain: float


class Scan:
    """The grid of places against the rows, summed by coarse voxels."""

    def __init__(self, rows: Rows, counts: CountModel, spectra: Spectra, ground: Ground, places: Array) -> None:
        """``places``: (G, 3) metres; the third coordinate is the height above the ground."""
        self._counts, self._spectra, self._places = counts, spectra, places
        self._voxels = rows.coarse
        live = self._voxels @ counts.live_s
        middle = (self._voxels @ (counts.place * counts.live_s[:, None])) / live[:, None]
        at = np.column_stack((places[:, :2], ground.heights_m(places[:, :2]) + places[:, 2]))
        square = (at**2).sum(axis=1)[:, None] + (middle**2).sum(axis=1) - 2.0 * at @ middle.T
        distance = np.sqrt(np.maximum(square, NEAREST_M**2))
        self._depth: Array = _AIR_PER_M * distance
        self._steepness: Array = np.maximum(middle[:, 2] - at[:, 2:], 0.0) / distance
        self._w: Array = PER_MM2 * np.exp(-self._depth) / distance**2  # (G, voxels)

    def candidates(self, solution: Solution) -> list[Candidate]:
        """Return the most promising candidates, at most ``_MOST``, best first.

        With the score s of a small activity and its variance h, the test s^2 / 2 h estimates the gain of log likelihood, and s /
        h the activity.
        """
        counts = self._counts
        expected = counts.views(counts.expected(solution)).mean  # a hidden source has no expected counts
        shapes = self._spectra.templates(solution.scale, solution.scatter, solution.soil)
        strengths = self._spectra.strengths(Sight(self._depth, 0.0, self._steepness))
        each = [(self._w * strengths[q], shapes[:, q]) for q in self._spectra.level]  # (G, voxels), (N, BINS)
        weighted = (counts.live_s * counts.weight)[:, None]
        excess = self._voxels @ (weighted * (counts.counts / expected - 1.0))
        variance = self._voxels @ (weighted * counts.live_s[:, None] / expected)
        score = sum(w @ (excess @ shape.T) for w, shape in each)  # (G, N)
        near = each[:1] + each[2:]  # without the air's scatter
        information = sum((w * v) @ (variance @ (shape * other).T) for w, shape in near for v, other in near)
        gain = np.where(score > 0.0, 0.5 * score**2 / np.maximum(information, 1e-300), 0.0)
        return self._best(gain, score / np.maximum(information, 1e-300))

    def _best(self, gain: Array, activity: Array) -> list[Candidate]:
        found: list[Candidate] = []
        left = gain.copy()
        while len(found) < _MOST:
            g, n = divmod(int(left.argmax()), left.shape[1])
            if left[g, n] < _LEAST_GAIN:
                break
            place, height = self._places[g, :2], float(self._places[g, 2])
            found.append(Candidate(n, place, height, float(np.log(activity[g, n])), float(gain[g, n])))
            near = ((self._places[:, :2] - place) ** 2).sum(axis=1) < _APART_M**2
            left[near, n] = 0.0
        return found


def raised_grid(area: Polygon, lowest_m: float, highest_m: float) -> Array:
    """Return (G, 3) places of the area with heights above the ground.

    Spacing on the lowest level: ``_GRID_M``, or wider where the places would be too many. The other levels are ``_LEVEL_M`` above
    each other, with twice the spacing.
    """
    levels = np.linspace(lowest_m, highest_m, 1 + math.ceil((highest_m - lowest_m) / _LEVEL_M)).tolist()
    places = [grid_of(area, _GRID_M, _MOST_PLACES), *[grid_of(area, 2.0 * _GRID_M, _MOST_PLACES // 4)] * (len(levels) - 1)]
    return np.vstack([np.column_stack((at, np.full(len(at), level))) for at, level in zip(places, levels, strict=True)])


def spacing_m(area: Polygon, apart_m: float, most: int) -> float:
    """Return the spacing of the places of ``grid_of``, metres."""
    west, south, east, north = area.bounds
    return max(apart_m, math.sqrt((east - west) * (north - south) / most))


def grid_of(area: Polygon, apart_m: float, most: int) -> Array:
    """Return (G, 2) places of the area, ``apart_m`` apart, or further where there would be more than ``most``."""
    west, south, east, north = area.bounds
    spacing = spacing_m(area, apart_m, most)
    x, y = np.meshgrid(np.arange(west + spacing / 2, east, spacing), np.arange(south + spacing / 2, north, spacing))
    places = np.column_stack((x.ravel(), y.ravel()))
    inside: Array = places[contains_xy(area, places[:, 0], places[:, 1])]
    inside = inside if len(inside) else np.array([[area.centroid.x, area.centroid.y]])
    return inside
