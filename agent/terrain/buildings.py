"""How much of a source's photons the known walls and buildings take off on a straight line of sight. Mission frame, metres."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.polygon import orient

from radron.agent.config.buildings import BuildingConfig, BuildingsConfig, Material
from radron.agent.geometry import Array
from radron.agent.terrain.ground import Ground

_AIR_KG_PER_M3 = 1.205  # at 20 degrees, as in the attenuations of air that the nuclides' responses have
# Density, and mass attenuation relative to air's, from 0.4 to 1.5 MeV (NIST: ordinary concrete, iron). Photons are scattered by
# electrons there, so the ratio is that of the electrons per mass and hardly depends on the energy; at 0.3 MeV steel has 8 % more.
_MATERIALS: dict[Material, tuple[float, float]] = {
    "concrete": (2300.0, 1.022),
    "brick": (1800.0, 1.02),
    "wood": (600.0, 1.06),
    "glass": (2500.0, 1.0),
    "steel": (7850.0, 0.955),
}
_LEVEL_M = 1e-9  # stands for a horizontal or vertical way of length zero
_PORTION = 20_000  # ways at once: in a town, each is compared with some hundred buildings


def attenuation_per_m(building: BuildingConfig, air_per_m: float) -> float:
    """Return the linear attenuation coefficient (1/m) of a building's material for the nuclide's photons.

    air_per_m: coefficient of air for the same photons, from which the material's coefficient follows by density.
    """
    if building.attenuation_per_m is not None:
        return building.attenuation_per_m
    density, relative = _MATERIALS[building.material]
    return air_per_m * relative * density / _AIR_KG_PER_M3


class Buildings:
    """The attenuation of a source's photons by all known walls and buildings, which are upright prisms on the ground.

    A prism stands at the height of the ground in the middle of its outline.
    """

    def __init__(self, config: BuildingsConfig, air_per_m: float, ground: Ground) -> None:
        """Prepare the sides of all prisms. ``air_per_m``: linear attenuation coefficient (1/m) of air for the nuclide's
        photons.
        """
        sides, tops, strengths, boxes = [], [], [], []
        for building in config.known:
            outline = orient(Polygon(building.footprint_m))  # counter-clockwise
            corners = np.array(outline.exterior.coords)
            sides.append(np.hstack((corners[:-1], corners[1:])))
            tops += [ground.height_m(outline.centroid.x, outline.centroid.y) + building.height_m] * len(sides[-1])
            strengths += [attenuation_per_m(building, air_per_m)] * len(sides[-1])
            boxes.append(outline.bounds)
        self._sides = np.vstack(sides) if sides else np.empty((0, 4))
        self._tops, self._strengths, self._boxes = np.array(tops), np.array(strengths), np.array(boxes).reshape(-1, 4)
        self._count = np.array([len(one) for one in sides], np.intp)  # sides of each building
        self._first = np.cumsum(self._count) - self._count

    def __bool__(self) -> bool:
        return len(self._sides) > 0

    def depth(self, start: Array, way: Array) -> Array:
        """Return the optical depth (N,), the exponent of the attenuation, of all buildings along N straight lines of sight.

        start: (N, 3) begin of each line, m, mission frame. way: (N, 3) vector from there to the end of each line, m.

        Along a line, a prism's share is the sum over its sides of the exit places minus the entry places. Both are cut off at the
        ends of the line and at its passage through the roof's height.
        """
        portions = [slice(first, first + _PORTION) for first in range(0, max(len(way), 1), _PORTION)]
        return np.concatenate([self._depth(start[portion], way[portion]) for portion in portions])

    def _depth(self, start: Array, way: Array) -> Array:
        of, sides = self._met(start, start + way)
        if not len(of):
            return np.zeros(len(way))
        (x0, y0, z0), (dx, dy, dz) = start[of].T, way[of].T
        dx = np.where(dx * dx + dy * dy > _LEVEL_M**2, dx, _LEVEL_M)
        level = dx * dx + dy * dy
        px, py, qx, qy = (self._sides[sides] - np.column_stack((x0, y0, x0, y0))).T
        first, second = dx * py - dy * px, dx * qy - dy * qx  # to the left of the line, each end of a side
        crosses = (first < 0.0) != (second < 0.0)
        share = first / np.where(crosses, first - second, 1.0)
        along = ((px + share * (qx - px)) * dx + (py + share * (qy - py)) * dy) / level
        dz = np.where(np.abs(dz) > _LEVEL_M, dz, -_LEVEL_M)
        roof = np.clip((self._tops[sides] - z0) / dz, 0.0, 1.0)  # the line's passage through the roof's height
        inside = np.clip(along, np.where(dz < 0.0, roof, 0.0), np.where(dz < 0.0, 1.0, roof))
        leaving = np.where(first < 0.0, inside, -inside) * crosses
        total = np.bincount(of, leaving * self._strengths[sides], len(way))
        result: Array = np.sqrt(np.vecdot(way, way)) * np.maximum(total, 0.0)
        return result

    def _met(self, start: Array, end: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Indices of ways, and of the sides they may meet: sides of buildings with a rectangle that overlaps the way's, of a town
        a few."""
        low, high = np.minimum(start, end), np.maximum(start, end)
        west, south, east, north = self._boxes.T
        overlaps = (west <= high[:, 0, None]) & (east >= low[:, 0, None])
        overlaps &= (south <= high[:, 1, None]) & (north >= low[:, 1, None])
        ways, met = np.nonzero(overlaps)
        count = self._count[met]
        first = np.repeat(self._first[met] - (np.cumsum(count) - count), count)
        return np.repeat(ways, count), first + np.arange(len(first))
