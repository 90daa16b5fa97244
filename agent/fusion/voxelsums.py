"""Exposures summed by drone and voxel, in integers: sums of integers do not depend on the order of the summands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from radron.agent.fusion.observation import CountObservation
from radron.agent.geometry import Array

Integers = NDArray[np.int64]

FINE = 1_000_000  # units of facing


@dataclass(frozen=True, eq=False)
class VoxelSums:
    """R sums over exposures, ascending by drone and voxel.

    table: (R, columns) the key, which begins with the drone's number; live time (ns); sums of the position (mm, 3) and of the
    facing (1e-6, 2) times live time (ns); other sums. KEYS: columns of the key.
    """

    KEYS: ClassVar[int]
    table: Integers

    def __len__(self) -> int:
        return len(self.table)

    @property
    def drone(self) -> Integers:
        """(R,) numbers of the drones, ascending."""
        return self.table[:, 0]

    @property
    def live_s(self) -> Array:
        """(R,) live times."""
        return np.asarray(self._live * 1e-9, np.float64)

    @property
    def place(self) -> Array:
        """(R, 3) mean positions, mission frame, metres."""
        return np.asarray(self.table[:, self.KEYS + 1 : self.KEYS + 4] / self._live[:, None] * 1e-3, np.float64)

    @property
    def facing(self) -> Array:
        """(R, 2) means of cos 2 psi and sin 2 psi, psi the heading."""
        return np.asarray(self.table[:, self.KEYS + 4 : self.KEYS + 6] / self._live[:, None] / FINE, np.float64)

    @property
    def _live(self) -> Integers:
        return self.table[:, self.KEYS]


def weighted(observation: CountObservation, mm: list[int]) -> list[int]:
    """Return live time and sums of position and facing of one exposure; mm: its position."""
    live_ns = round(observation.live_time_s * 1e9)
    facing = [round(FINE * part) for part in observation.facing]
    return [live_ns, *(part * live_ns for part in (*mm, *facing))]


def summed(table: Integers, keys: int) -> Integers:
    """Return a table with the rows of equal keys (the first columns) added up, ascending by key."""
    key, index = np.unique(table[:, :keys], axis=0, return_inverse=True)
    result = np.zeros((len(key), table.shape[1]), np.int64)
    np.add.at(result, index.ravel(), table)
    result[:, :keys] = key
    return result
