"""The true shape of the ground: smooth hills and hollows on a plane. The agents know only their mission's grid."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from radron.agent.config.mission import Corner
from radron.agent.config.section import Coordinate
from radron.sim.geometry import Array

Grade = Annotated[float, Meta(ge=-1.0, le=1.0)]

CONCRETE_PER_SOIL = 0.65  # soil of 1.5 g/cm3 against concrete of 2.3: attenuation of gamma rays is by mass
_SIGHT_STEPS = 48  # a line of sight of 50 m is sampled every metre: hills are tens of metres wide


class HillTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A hill of the ground, or a hollow with ``height_m`` below zero: a Gaussian bell with the standard deviation ``width_m``."""

    centre_m: Corner
    height_m: Annotated[float, Meta(ge=-1000.0, le=1000.0)]
    width_m: Annotated[float, Meta(ge=1.0, le=1e4)] = 15.0


class TerrainTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """True shape of the ground: hills on the plane ``height_m + slope . (x, y)`` in the mission frame.

    The default is flat, at height zero.
    """

    height_m: Coordinate = 0.0
    slope: tuple[Grade, Grade] = (0.0, 0.0)
    hills: Annotated[tuple[HillTruth, ...], Meta(max_length=256)] = ()


class Terrain:
    """The true ground of a scenario, with its height at any position; mission frame."""

    def __init__(self, truth: TerrainTruth) -> None:
        self.flat = truth == TerrainTruth()
        self._base, self._slope = truth.height_m, truth.slope
        self._centre = np.array([hill.centre_m for hill in truth.hills]).reshape(-1, 2)
        self._height = np.array([hill.height_m for hill in truth.hills])
        self._sharpness = np.array([0.5 / hill.width_m**2 for hill in truth.hills])

    def heights_m(self, x: Array, y: Array) -> Array:
        """Return the heights of the ground at positions (N,), metres."""
        ground: Array = self._base + self._slope[0] * x + self._slope[1] * y
        if len(self._height):
            squared = (x[:, None] - self._centre[:, 0]) ** 2 + (y[:, None] - self._centre[:, 1]) ** 2
            ground += np.exp(-squared * self._sharpness) @ self._height
        return ground

    def height_m(self, x: float, y: float) -> float:
        """Return the height of the ground at one position, metres."""
        return 0.0 if self.flat else float(self.heights_m(np.array([x]), np.array([y]))[0])

    def on_ground(self, positions: Array) -> Array:
        """Project positions (N, 3) vertically onto the ground; over flat ground they are returned unchanged."""
        if self.flat:
            return positions
        return np.column_stack((positions[:, :2], self.heights_m(positions[:, 0], positions[:, 1])))

    def above_ground(self, positions: Array) -> Array:
        """Return positions (N, 3) with the height above the ground instead of z."""
        if self.flat:
            return positions
        above = positions.copy()
        above[:, 2] -= self.heights_m(positions[:, 0], positions[:, 1])
        return above

    def soil_m(self, start: Array, end: Array) -> float:
        """Return the length of soil on the straight line between two points (3,), metres."""
        if self.flat:
            return 0.0
        shares = (np.arange(_SIGHT_STEPS) + 0.5) / _SIGHT_STEPS
        places = start + shares[:, None] * (end - start)
        under = np.count_nonzero(self.above_ground(places)[:, 2] < 0.0)
        return float(np.linalg.norm(end - start)) * under / _SIGHT_STEPS


FLAT = Terrain(TerrainTruth())
