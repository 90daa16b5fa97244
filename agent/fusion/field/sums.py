"""The measurements: exposures summed by drone and voxel, in integers, so that the sums do not depend on the order of entries."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radron.agent.fusion.observation import CountObservation
from radron.agent.geometry import Array

Integers = NDArray[np.int64]

FINEST_MM: Final = 600  # side of the smallest voxels; the others are 2, 4, ... times as large
MAX_LEVEL: Final = 6
MAX_PLACE_MM: Final = 1_000_000  # from the mission frame's origin: the sums over an hour fit into 64 bits
_FINE: Final = 1_000_000  # units of facing
_KEY, _LIVE, _PLACE, _FACING, _COUNTS = slice(0, 5), 5, slice(6, 9), slice(9, 11), 11
_VOXEL = slice(2, 5)
MAX_SUMS: Final = 2000  # of one fit: its time grows with them


@dataclass(frozen=True, eq=False)
class Sums:
    """R sums over exposures, ascending by drone and voxel.

    table: (R, 11 + C) drone's number; level and voxel (3); live time (ns); sums of the position (mm, 3) and of the facing
    (1e-6, 2) times live time; counts by channel.
    """

    table: Integers

    @classmethod
    def none(cls, channels: int) -> Sums:
        """Return sums without exposures."""
        return cls(np.zeros((0, _COUNTS + channels), np.int64))

    def __len__(self) -> int:
        return len(self.table)

    def plus(self, rows: Iterable[list[int]]) -> Sums:
        """Return the sums with further ``row_of`` exposures."""
        more = list(rows)
        if not more:
            return self
        return Sums(_summed(np.concatenate((self.table, np.array(more, np.int64)))))

    def limited(self, most: int = MAX_SUMS) -> Sums:
        """Return at most so many sums: those of voxels of twice the side, as often as needed."""
        table = self.table
        while len(table) > most and np.any(np.abs(table[:, _VOXEL] + 0.5) > 0.5):
            table = table.copy()
            table[:, 1] += 1
            table[:, _VOXEL] //= 2
            table = _summed(table)
        return Sums(table)

    @property
    def drone(self) -> Integers:
        """(R,) numbers of the drones."""
        return self.table[:, 0]

    @property
    def live_s(self) -> Array:
        """(R,) live times."""
        return np.asarray(self.table[:, _LIVE] * 1e-9, np.float64)

    @property
    def place(self) -> Array:
        """(R, 3) mean positions, mission frame, metres."""
        return np.asarray(self.table[:, _PLACE] / self.table[:, _LIVE, None] * 1e-3, np.float64)

    @property
    def facing(self) -> Array:
        """(R, 2) means of cos 2 psi and sin 2 psi, psi the heading."""
        return np.asarray(self.table[:, _FACING] / self.table[:, _LIVE, None] / _FINE, np.float64)

    @property
    def counts(self) -> Array:
        """(R, C) counts by channel."""
        return self.table[:, _COUNTS:].astype(np.float64)


def _summed(table: Integers) -> Integers:
    """Return the table with rows of the same drone and voxel added up, ascending."""
    keys, index = np.unique(table[:, _KEY], axis=0, return_inverse=True)
    result = np.zeros((len(keys), table.shape[1]), np.int64)
    np.add.at(result, index.ravel(), table)
    result[:, _KEY] = keys
    return result


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
    live_ns = round(observation.live_time_s * 1e9)
    voxel = (part // (FINEST_MM << level) for part in mm)
    facing = (round(_FINE * part) for part in observation.facing)
    weighted = (part * live_ns for part in (*mm, *facing))
    return [number, level, *voxel, live_ns, *weighted, *counted(observation)]


def rows_of(
    observations: Iterable[CountObservation],
    numbers: Mapping[str, int],
    height_m: Callable[[CountObservation], float],
    counted: Callable[[CountObservation], tuple[int, ...]],
) -> list[list[int]]:
    """Return the rows of exposures."""
    rows = (row_of(one, numbers[one.identity.drone], height_m(one), counted) for one in observations)
    return [row for row in rows if row is not None]
