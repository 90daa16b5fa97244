"""Contaminated ground of a simulated flight: activity per area on small cells, drawn from the seed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon

from radron.sim.geometry import Array
from radron.sim.radiation.ground.area import AreaSource
from radron.sim.scenario import Scenario
from radron.sim.world.contaminationtruth import ContaminationTruth
from radron.sim.world.source import anywhere
from radron.sim.world.sources import Source
from radron.sim.world.streams import Streams

Shape = Callable[[Array, Array], Array]  # places (east, north) -> share of the level, 0 to 1

# Of patterns with edges as fine as low drones could ever tell; of smooth and wide ones as coarse as a camera 3 m above them
# does not notice: the rate over an endless grid of points 2 m apart ripples by exp(-2 pi 3 / 2).
_FINE_M, _COARSE_M, _SPOT_M = 1.0, 2.0, 0.5
_CELL_M = {"uniform": _COARSE_M, "gradient": _COARSE_M, "blobs": _COARSE_M, "plume": _COARSE_M, "spots": _SPOT_M}
_SUBCELLS = 4  # a cell at an edge is covered in parts, by the share of 4 x 4 places
_MIN_SHARE = 1e-3  # of the level; less is no contamination
_REACH_M = 30.0  # outside the area, beyond which no pattern is laid out


@dataclass(frozen=True, slots=True)
class Contaminated:
    """One contaminated part of the ground. kind: its pattern. source: its cells. spots: its discs as point sources, if any."""

    kind: str
    source: AreaSource
    spots: tuple[Source, ...] = ()

    @property
    def reach_m(self) -> float:
        """Largest extent, east or north, of the places above half of the highest activity."""
        above = self.source.activity_bq > 0.5 * self.source.activity_bq.max()
        x, y = self.source.x_m[above], self.source.y_m[above]
        return float(max(np.ptp(x), np.ptp(y))) + self.source.cell_m


def contaminated_ground(scenario: Scenario, random: Streams) -> tuple[Contaminated, ...]:
    """Return the contaminated parts of the ground of a flight, in the order of the scenario."""
    area = Polygon(scenario.mission.area.polygon_m)
    return tuple(_drawn(truth, area, random.contamination) for truth in scenario.contamination)


def _drawn(truth: ContaminationTruth, area: Polygon, rng: np.random.Generator) -> Contaminated:
    kind = truth.patterns[int(rng.integers(len(truth.patterns)))]
    size_m = float(rng.uniform(*truth.size_m))
    if kind == "spots":
        return _spots(truth, size_m, area, rng)
    margin_m = truth.margin_m if kind == "uniform" else _REACH_M
    shape = _uniform(area.buffer(margin_m)) if kind == "uniform" else _shape(kind, size_m, area, rng)
    return Contaminated(kind, _cells(truth, shape, area.buffer(margin_m).bounds, _CELL_M.get(kind, _FINE_M)))


def _spots(truth: ContaminationTruth, size_m: float, area: Polygon, rng: np.random.Generator) -> Contaminated:
    count = int(rng.integers(truth.count[0], truth.count[1] + 1))
    inner = area.buffer(-0.5 * size_m)
    places = [anywhere(inner, rng) for _ in range(count)]

    def share(x: Array, y: Array) -> Array:
        return np.asarray(np.any([np.hypot(x - east, y - north) < 0.5 * size_m for east, north in places], axis=0), np.float64)

    spot_bq = truth.level_bqm2 * math.pi * (0.5 * size_m) ** 2
    spots = tuple(Source(truth.nuclide, spot_bq, (east, north, 0.0)) for east, north in places)
    return Contaminated("spots", _cells(truth, share, area.bounds, _SPOT_M), spots)


def _cells(truth: ContaminationTruth, share: Shape, bounds: Sequence[float], cell_m: float) -> AreaSource:
    """The cells of a pattern within bounds (west, south, east, north)."""
    west, south, east, north = bounds
    x, y = np.meshgrid(_middles(west, east, cell_m), _middles(south, north, cell_m))
    offsets = ((np.arange(_SUBCELLS) + 0.5) / _SUBCELLS - 0.5) * cell_m
    mean = np.mean([share(x + dx, y + dy) for dx in offsets for dy in offsets], axis=0)
    kept = mean > _MIN_SHARE
    return AreaSource(truth.nuclide, x[kept], y[kept], truth.level_bqm2 * cell_m**2 * mean[kept], cell_m)


def _middles(low: float, high: float, cell_m: float) -> Array:
    return np.asarray(low + (np.arange(math.ceil((high - low) / cell_m - 1e-9)) + 0.5) * cell_m, np.float64)


def _uniform(whole: Polygon) -> Shape:
    return lambda x, y: np.asarray(shapely.contains_xy(whole, x, y), np.float64)


def _shape(kind: str, size_m: float, area: Polygon, rng: np.random.Generator) -> Shape:
    """A pattern at a place and in a direction drawn from the seed; all but streets have their middle well inside the area."""
    inner = area.buffer(-0.5 * size_m)
    middle = anywhere(area if kind == "streets" or inner.is_empty else inner, rng)
    angle = float(rng.uniform(0.0, 2.0 * math.pi))
    pattern = _blobs(angle, middle, area) if kind == "blobs" else _PATTERNS[kind]

    def share(x: Array, y: Array) -> Array:
        east, north = x - middle[0], y - middle[1]
        along = east * math.cos(angle) + north * math.sin(angle)
        across = north * math.cos(angle) - east * math.sin(angle)
        return np.asarray(pattern(along / size_m, across / size_m), np.float64)

    return share


def _gaussian(u: Array, v: Array) -> Array:
    return np.asarray(np.exp(-2.0 * (u * u + v * v)))


def _plume(u: Array, v: Array) -> Array:
    """Downwind of its begin at u = -0.5: falls to a fifth at u = 0.5, and widens from 0.05 to 0.15 of its length."""
    way = u + 0.5
    width = 0.05 + 0.1 * np.clip(way, 0.0, None)
    return np.asarray(np.where(way >= 0.0, np.exp(-math.log(5.0) * way - 0.5 * (v / width) ** 2), 0.0))


def _l(u: Array, v: Array) -> Array:
    inside = (np.abs(u) < 0.5) & (np.abs(v) < 0.5)
    return np.asarray(inside & ((u < -1.0 / 6.0) | (v < -1.0 / 6.0)), np.float64)


def _ring(u: Array, v: Array) -> Array:
    radius = np.hypot(u, v)
    return np.asarray((radius < 0.5) & (radius > 0.25), np.float64)


def _blobs(angle: float, middle: tuple[float, float], area: Polygon) -> Shape:
    """Two Gaussians whose middles are two sizes apart, the second on the side of the area's middle."""
    centre = area.centroid
    along = (centre.x - middle[0]) * math.cos(angle) + (centre.y - middle[1]) * math.sin(angle)
    apart = 2.0 if along > 0.0 else -2.0
    return lambda u, v: np.asarray(_gaussian(u, v) + 0.6 * _gaussian(u - apart, v))


_PATTERNS: dict[str, Shape] = {
    "patch": lambda u, v: np.asarray((np.abs(u) < 0.5) & (np.abs(v) < 0.5), np.float64),
    "gradient": _gaussian,
    "streets": lambda u, v: np.asarray((np.abs(u) < 0.5) | (np.abs(v) < 0.5), np.float64),
    "l": _l,
    "ring": _ring,
    "plume": _plume,
}
