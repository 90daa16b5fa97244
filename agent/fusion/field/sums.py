"""The measurements: exposures summed by drone and voxel, whose size grows with the height above the ground."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from radron.agent.fusion.observation import CountObservation
from radron.agent.fusion.voxelsums import VoxelSums, summed, weighted
from radron.agent.geometry import Array

FINEST_MM: Final = 600  # side of the smallest voxels; the others are 2, 4, ... times as large
MAX_LEVEL: Final = 6
MAX_PLACE_MM: Final = 1_000_000  # from the mission frame's origin: the sums over an hour fit into 64 bits
_VOXEL, _COUNTS = slice(2, 5), 11
MAX_SUMS: Final = 2000  # of one fit: its time grows with them


@dataclass(frozen=True, eq=False)
class Sums(VoxelSums):
    """Sums of counts by channel. Key: drone's number, level and voxel (3). Other sums: counts by channel."""

    KEYS: ClassVar[int] = 5

    @classmethod
    def none(cls, channels: int) -> Sums:
        """Return sums without exposures."""
        return cls(np.zeros((0, _COUNTS + channels), np.int64))

    def plus(self, rows: Iterable[list[int]]) -> Sums:
        """Return the sums with further ``row_of`` exposures."""
        more = list(rows)
        if not more:
            return self
        return Sums(summed(np.concatenate((self.table, np.array(more, np.int64))), self.KEYS))

    def limited(self, most: int = MAX_SUMS) -> Sums:
        """Return at most so many sums: those of voxels of twice the side, as often as needed."""
        table = self.table
        while len(table) > most and np.any(np.abs(table[:, _VOXEL] + 0.5) > 0.5):
            table = table.copy()
            table[:, 1] += 1
            table[:, _VOXEL] //= 2
            table = summed(table, self.KEYS)
        return Sums(table)

    @property
    def counts(self) -> Array:
        """(R, C) counts by channel."""
        return self.table[:, _COUNTS:].astype(np.float64)


def row_of(
    observation: CountObservation,
    number: int,
    height_m: float,
    counted: Callable[[CountObservation], tuple[int, ...]],
) -> list[int] | None:
    """Return the row of one exposure, in a voxel of at most half the camera's height; None for a place out of range.

    number: of the drone. height_m: of the camera above the ground. counted: the detector's counts by channel.
    """
    mm = [round(1e3 * part) for part in observation.position]
    if max(map(abs, mm)) > MAX_PLACE_MM:
        return None
    level = min(max(math.floor(math.log2(max(500.0 * height_m, 1.0) / FINEST_MM)), 0), MAX_LEVEL)
    voxel = (part // (FINEST_MM << level) for part in mm)
    return [number, level, *voxel, *weighted(observation, mm), *counted(observation)]


def rows_of(
    observations: Iterable[CountObservation],
    numbers: Mapping[str, int],
    height_m: Callable[[CountObservation], float],
    counted: Callable[[CountObservation], tuple[int, ...]],
) -> list[list[int]]:
    """Return the rows of exposures."""
    rows = (row_of(one, numbers[one.identity.drone], height_m(one), counted) for one in observations)
    return [row for row in rows if row is not None]
