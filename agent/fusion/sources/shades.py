"""Transmission of known walls and buildings for a source's direct photons, on the lines of sight from many places.

A place stands for a voxel and for a drone's position error, so a line of sight stands for its surroundings. These are itself, and
four lines from places ``_ASIDE_M`` to each side. Their mean is the expected transmission. Buildings attenuate direct photons;
scattered photons come around them.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from radron.agent.config.buildings import BuildingsConfig
from radron.agent.geometry import Array, Vector3
from radron.agent.terrain.buildings import Buildings
from radron.agent.terrain.ground import Ground

_ASIDE_M = 0.25
_LINES: Array = _ASIDE_M * np.array([(0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)], np.float64)
_LEAST_SIGMA_M, _MOST_SIGMA_M = 0.1, 2.0  # of a source's place: for walls on a map, too; a larger sigma says nothing more
_KEPT = 32  # shares requested repeatedly by a fit: of its sources at the solutions that it compares
_LINES_KEPT = 4  # sources requested again for another nuclide; ten times as large as a share


class KnownWalls:
    """The mission's walls and buildings, for photons of any nuclide."""

    def __init__(self, config: BuildingsConfig, air_per_m: Array, ground: Ground) -> None:
        """``air_per_m``: (N,) attenuation by air of the nuclides' photons, to which that of materials is proportional."""
        materials = tuple(one for one in config.known if one.attenuation_per_m is None)
        others = tuple(one for one in config.known if one.attenuation_per_m is not None)
        self._materials, self._others = (Buildings(BuildingsConfig(known=part), 1.0, ground) for part in (materials, others))
        self._air_per_m = air_per_m

    def __bool__(self) -> bool:
        return bool(self._materials) or bool(self._others)

    def lines(self, sources: Array, places: Array) -> Lines:
        """Return lines from places (N, 3) to sources (N, 3), or to one (3,)."""
        start = (places + _LINES[:, None]).reshape(-1, 3)
        way = (sources - places - _LINES[:, None]).reshape(-1, 3)
        material, other = (part.depth(start, way).reshape(len(_LINES), -1) for part in (self._materials, self._others))
        return Lines(material, other, self._air_per_m)


class Lines:
    """N lines of sight with their neighbours."""

    def __init__(self, material_m: Array, other: Array, air_per_m: Array) -> None:
        """Optical depths (5, N): of buildings by material, as the equivalent metres of air; and of the others."""
        self._material_m, self._other, self._air_per_m = material_m, other, air_per_m

    def shares(self, nuclide: int) -> Array:
        """Return the (5, N) shares of the direct photons of a nuclide that pass."""
        result: Array = np.exp(-self._air_per_m[nuclide] * self._material_m - self._other)
        return result


class Shades:
    """Known walls between some places and any sources."""

    def __init__(self, walls: KnownWalls, places: Array) -> None:
        """``places``: (N, 3), mission frame."""

        @lru_cache(_LINES_KEPT)
        def lines(source: Vector3) -> Lines:
            return walls.lines(np.array(source), places)

        @lru_cache(_KEPT)
        def passing(nuclide: int, source: Vector3) -> Array:
            result: Array = lines(source).shares(nuclide).mean(axis=0)
            return result

        self._lines, self._passing = lines, passing  # neither refers to ``self``: a cycle would outlive its fit where gc is off

    def passing(self, nuclide: int, source: Vector3) -> Array:
        """Return the expected transmission (N,) for the direct photons of a source, mission frame."""
        return self._passing(nuclide, source)

    def spread(self, nuclide: int, source: Vector3, sigma_m: Array) -> tuple[Array, Array]:
        """Return that transmission, and its 1 sigma, for a source with position errors sigma_m (2,) along x and y."""
        x, y, z = source
        east, north = np.clip(sigma_m, _LEAST_SIGMA_M, _MOST_SIGMA_M).tolist()
        around = (x, y, z), (x + east, y, z), (x - east, y, z), (x, y + north, z), (x, y - north, z)
        share = self.passing(nuclide, source)
        shares = np.concatenate([self._lines(one).shares(nuclide) for one in around])
        return share, shares.std(axis=0)
