"""Informative search: choice of the waypoint with the largest expected information gain, on the way and there.

The information that a count over T seconds gives about the position of a source is 4 T Var(sqrt(lambda)) over the possible
positions, with the expected rate lambda. (The square root of a Poisson count has a variance of 1/4, whatever the rate.) The
information is zero if all possible positions give the same rate: far away, or where a source has been excluded.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, sqrt

import numpy as np
import shapely
from msgspec import Struct
from numpy.typing import NDArray
from shapely import Polygon

from radron.agent.geometry import Array, Point2

Indices = NDArray[np.intp]

# Approximate values suffice for planning: hits per second of one camera at 1 m from 1 Bq, the background rate, and attenuation
# in air (of Cs-137 at 662 keV: 15.8 mm2 x 0.851 / 4 pi, 1.5 hits/s, 0.00934 per m).
HITS_PER_BQ = 1.07e-6
BACKGROUND_PS = 1.5
_AIR_PER_M = 0.00934
_BLOCKS = 300  # number of blocks into which possible source positions are pooled; more if they were larger than _COARSEST_M
_NODES = 200  # number of candidate waypoints; likewise
_COARSEST_M = 12.0  # largest spacing of blocks and waypoints: about the distance at which a weak source can be measured
LARGEST_M2 = 90_000.0  # largest bounding box of an area: limits the computation to a few ms
_SAMPLES = 12  # points on the way to a waypoint at which the information rate is evaluated
_HORIZON_S = 15.0  # time over which information is added up
_STAY = 0.5  # weight of time spent at the waypoint: a further measurement at one place gives less information
_LEFT = 0.2  # weight of positions that are left to the other drones


class Belief(Struct, frozen=True):
    """Posterior of the search, as the planner needs it: C possible positions of a source on a regular grid.

    places: (C, 2) m. weight: (C,), probability of a source at each; their sum is 1 - ``none``. activity_bq: (C,), expected
    activity of a source there. none: probability that there is no source.
    """

    places: Array
    weight: Array
    activity_bq: Array
    none: float


class Waypoints:
    """Choice of waypoints with the largest expected information gain in an area with a bounding box of at most LARGEST_M2."""

    def __init__(self, area: Polygon, height_m: float, speed_mps: float, acceleration_mps2: float) -> None:
        """Set up the candidate waypoints.

        ``height_m``: flight height above the ground, on which the source lies. Speed and acceleration are the limits of the
        flight.
        """
        self._height_m, self._speed_mps, self._turn_mps2 = height_m, speed_mps, acceleration_mps2
        west, south, east, north = area.bounds
        pitch_m = min(max(sqrt((east - west) * (north - south) / _NODES), 2.0), _COARSEST_M)
        columns, rows = (max(1, ceil(side / pitch_m)) for side in (east - west, north - south))
        self._shape = rows, columns
        self._corner = (west, south)
        self._pitch = ((east - west) / columns, (north - south) / rows)
        x, y = np.meshgrid(west + self._pitch[0] * (np.arange(columns) + 0.5), south + self._pitch[1] * (np.arange(rows) + 0.5))
        self._nodes: Array = np.column_stack((x.ravel(), y.ravel()))  # (W, 2)
        inside = shapely.contains_xy(area, self._nodes[:, 0], self._nodes[:, 1])
        if not inside.any():  # the area is a sliver between the nodes
            middle = area.representative_point()
            self._candidates: Array = np.array([[middle.x, middle.y]])
        else:
            self._candidates = self._nodes[inside]
        self._places: Array | None = None  # the grid that the following were computed for
        self._blocks: Indices = np.empty(0, np.intp)  # (C,) block of each grid position
        self._centres: Array = np.empty((0, 2))
        self._gain: Array = np.empty((0, 0))  # (W, blocks) hits per second and Bq

    def choose(
        self,
        belief: Belief,
        position: Point2,
        velocity: Point2,
        others: Sequence[Point2] = (),
        behind: Sequence[tuple[float, float, float]] = (),
    ) -> Point2:
        """Return the waypoint (x, y) to fly to next.

        Args:
            belief: possible positions of a source.
            position: this drone's; frame of the area.
            velocity: this drone's.
            others: positions of the drones that share the search; source positions nearer to them are mostly left to them.
            behind: lines (x, y, b) that a waypoint p must not cross: n . p >= b with n = (x, y). If no candidate is behind all
                lines, those that violate them least count.
        """
        rates = self._information_rate(*self._pooled(belief), position, others)
        away = self._candidates - position
        distance = np.hypot(away[:, 0], away[:, 1])
        ahead = away / np.maximum(distance, 1e-6)[:, None]
        change = np.hypot(*(self._speed_mps * ahead - velocity).T)
        arrival_s = distance / self._speed_mps + change / (2.0 * self._turn_mps2)  # half of the turn's time is lost
        share = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
        on_way = rates[self._node_at(np.asarray(position) + away[:, None] * share[:, None])].mean(axis=1)
        flown_s = np.minimum(arrival_s, _HORIZON_S)
        learnt = flown_s * on_way + (_HORIZON_S - flown_s) * rates[self._node_at(self._candidates)] * _STAY
        if behind:
            slack = np.min([self._candidates @ line[:2] - line[2] for line in behind], axis=0)
            learnt = np.where(slack >= min(0.0, float(slack.max())), learnt, -np.inf)
        x, y = self._candidates[int(learnt.argmax())].tolist()
        return x, y

    def _pooled(self, belief: Belief) -> tuple[Array, Array, float]:
        """Return the probability and the mean activity of a source in each block, (B,) each, and the probability of no source."""
        if self._places is None or not np.array_equal(belief.places, self._places):
            self._make_blocks(belief.places)
        self._places = belief.places
        count = len(self._centres)
        weight = np.bincount(self._blocks, belief.weight, count).astype(np.float64)
        activity = np.bincount(self._blocks, belief.weight * belief.activity_bq, count) / np.maximum(weight, 1e-300)
        return weight, activity, belief.none

    def _make_blocks(self, places: Array) -> None:
        low, high = places.min(axis=0), places.max(axis=0)
        block_m = min(max(sqrt(max(float(np.prod(high - low)), 1.0) / _BLOCKS), 1.0), _COARSEST_M)
        sides = np.maximum(high - low, 1e-6)
        count = np.ceil(sides / block_m)
        cells = np.minimum((places - low) / sides * count, count - 1.0).astype(np.intp)
        _, self._blocks = np.unique(cells[:, 0] * 1_000_003 + cells[:, 1], return_inverse=True)
        size = np.bincount(self._blocks)
        self._centres = np.column_stack([np.bincount(self._blocks, places[:, axis]) / size for axis in (0, 1)])
        apart = self._nodes[:, None] - self._centres
        squared = np.einsum("wbx,wbx->wb", apart, apart) + self._height_m**2 + block_m**2 / 6.0
        self._gain = HITS_PER_BQ * np.exp(-_AIR_PER_M * np.sqrt(squared)) / squared

    def _information_rate(self, weight: Array, activity: Array, none: float, position: Point2, others: Sequence[Point2]) -> Array:
        """Return the information rate 4 Var(sqrt(lambda)) of counts at each node, (W,), per second."""
        if others:
            mine = np.hypot(*(self._centres - position).T)
            nearest = np.min([np.hypot(*(self._centres - other).T) for other in others], axis=0)
            weight = weight * np.where(mine <= nearest, 1.0, _LEFT)
        total = float(weight.sum()) + none
        weight, none = weight / total, none / total
        signal = self._gain * activity
        mean = signal @ weight + BACKGROUND_PS
        root = np.sqrt(signal + BACKGROUND_PS) @ weight + none * sqrt(BACKGROUND_PS)
        found: Array = 4.0 * np.maximum(mean - root * root, 0.0)
        return found

    def _node_at(self, points: Array) -> Indices:
        """Return the indices (...) of the nodes nearest to points (..., 2)."""
        columns = np.clip(((points[..., 0] - self._corner[0]) / self._pitch[0]).astype(np.intp), 0, self._shape[1] - 1)
        rows = np.clip(((points[..., 1] - self._corner[1]) / self._pitch[1]).astype(np.intp), 0, self._shape[0] - 1)
        numbers: Indices = rows * self._shape[1] + columns
        return numbers
