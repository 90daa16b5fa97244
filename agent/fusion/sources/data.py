"""The measurements: exposures summed by drone and voxel, in integers, and single cones.

The results computed from sums of integers do not depend on the order of the summands either.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from radron.agent.fusion.bayes.cones import Orders
from radron.agent.fusion.observation import ConeObservation, CountObservation
from radron.agent.fusion.sources.bins import pooled
from radron.agent.fusion.voxelsums import Integers, VoxelSums, summed, weighted
from radron.agent.geometry import Array
from radron.protocol.spectrum import BINS

_VOXEL_MM = 500
_COARSE = 4  # voxels on a side of a coarse one
_SPREAD, _COUNTS = 10, slice(11, 11 + BINS)
_COLUMNS = 11 + BINS
_FARTHEST_MM = 100_000_000  # from the mission frame's origin: beyond, a minute's sum would not fit into 64 bits
_LONGEST_WAY_M = 10.0  # limit of an exposure's way in the spread
UNTOLD_HITS = 5  # an exposure with at least so many hits and no spectrum is of a program that publishes none


@dataclass(frozen=True, eq=False)
class Rows(VoxelSums):
    """Sums with a spectrum. Key: drone's number, voxel (3). Other sums: mean squared distance from the voxel's middle (mm2) times
    live time (us); counts by bin.
    """

    KEYS: ClassVar[int] = 4

    @classmethod
    def none(cls) -> Rows:
        """Return rows without exposures."""
        return cls(np.zeros((0, _COLUMNS), np.int64))

    @classmethod
    def single(cls, observation: CountObservation, number: int) -> Rows:
        """Return the row of one exposure by the drone of that number; no row for an exposure without spectrum."""
        row = _row(observation, number)
        return cls.none() if row is None else cls(np.array([row], np.int64))

    def plus(self, observations: Iterable[CountObservation], numbers: dict[str, int]) -> Rows:
        """Return the rows with further exposures added; ``numbers``: the drones' numbers."""
        more = [row for one in observations for row in [_row(one, numbers[one.identity.drone])] if row is not None]
        if not more:
            return self
        return Rows(summed(np.concatenate((self.table, np.array(more, np.int64))), self.KEYS))

    @property
    def spread_m2(self) -> Array:
        """(R,) mean squared distance of the cameras from the mean position."""
        middle = (self.table[:, 1:4] + 0.5) * _VOXEL_MM * 1e-3
        about_middle = self.table[:, _SPREAD] / self._live * 1e-3
        return np.asarray(np.maximum(about_middle - ((self.place - middle) ** 2).sum(axis=1), 0.0), np.float64)

    @property
    def counts(self) -> Array:
        """(R, BINS) events, with the softest bins pooled."""
        return pooled(self.table[:, _COUNTS].astype(np.float64))

    @cached_property
    def coarse(self) -> csr_array:
        """(V, R) matrix that sums the rows of all drones in each of V coarse voxels, of 2 m."""
        keys, index = np.unique(self.table[:, 1:4] // _COARSE, axis=0, return_inverse=True)
        return summing(index.ravel(), len(keys))


def summing(group: NDArray[np.intp], groups: int) -> csr_array:
    """Return a (groups, N) matrix that sums the members of each group: ``group`` (N,)."""
    return csr_array((np.ones(len(group)), (group, np.arange(len(group)))), (groups, len(group)))


def _row(observation: CountObservation, number: int) -> list[int] | None:
    if not observation.spectrum and observation.counts[0] >= UNTOLD_HITS:
        return None
    mm = [round(1e3 * part) for part in observation.position]
    if max(map(abs, mm)) > _FARTHEST_MM:
        return None
    counts = [0] * BINS
    for one in observation.spectrum:
        counts[one.place] = one.singles + one.coincidences
    live_ns, *sums = weighted(observation, mm)
    spread = round(_spread_mm2(mm, observation.way_m)) * (live_ns // 1000)
    return [number, *(part // _VOXEL_MM for part in mm), live_ns, *sums, spread, *counts]


def _spread_mm2(mm: Sequence[int], way_m: float) -> float:
    """Return the mean squared distance (mm2) of a camera from its voxel's middle, on a straight way of ``way_m``."""
    off = [part % _VOXEL_MM - _VOXEL_MM / 2 for part in mm]
    return sum(part * part for part in off) + (1e3 * min(way_m, _LONGEST_WAY_M)) ** 2 / 12.0


@dataclass(frozen=True, eq=False)
class Cones:
    """C cones of two readings each. drone: (C,) numbers. apex: (C, 3) metres, mission frame. axis: (C, 2, 3) unit vectors;
    theta: (C, 2) rad. variance: (C, 2, 2) rad2 and weight: (C, 2, 2), see ``fusion.bayes.cones``. energy_kev: (C,).
    """

    drone: Integers
    apex: Array
    axis: Array
    theta: Array
    variance: Array
    weight: Array
    energy_kev: Array

    @classmethod
    def none(cls) -> Cones:
        """Return cones without entries."""
        shapes = ((0, 3), (0, 2, 3), (0, 2), (0, 2, 2), (0, 2, 2), (0,))
        return cls(np.zeros(0, np.int64), *(np.zeros(shape) for shape in shapes))

    def __len__(self) -> int:
        return len(self.drone)

    def plus(self, cones: Sequence[ConeObservation], numbers: dict[str, int]) -> Cones:
        """Return the cones with further, later cones appended."""
        if not cones:
            return self
        more = _cones(cones, numbers)
        joined = (np.concatenate((getattr(self, name), getattr(more, name))) for name in self.__dataclass_fields__)
        return Cones(*joined)


def _cones(cones: Sequence[ConeObservation], numbers: dict[str, int]) -> Cones:
    count = len(cones)
    axis, theta = np.zeros((count, 2, 3)), np.ones((count, 2))
    axis[:, :, 2] = 1.0
    variance, weight = np.ones((count, 2, 2)), np.zeros((count, 2, 2))  # no weight for a missing reading
    for place, cone in enumerate(cones):
        orders = Orders.of(cone)
        there = slice(0, len(orders.theta_rad))
        axis[place, there], theta[place, there] = orders.axis, orders.theta_rad
        variance[place, there], weight[place, there] = orders.variance, orders.weight
    return Cones(
        np.array([numbers[cone.identity.drone] for cone in cones]),
        np.array([cone.apex for cone in cones]),
        axis,
        theta,
        variance,
        weight,
        np.array([cone.energy_kev for cone in cones]),
    )
