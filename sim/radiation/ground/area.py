"""Photons of contaminated ground in a simulated camera: straight from small cells of it, and scattered by ground and air."""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from radron.sim.radiation._jit import jit
from radron.sim.radiation.bank import DIRECTION_BINS, bin_centres
from radron.sim.radiation.concrete import concrete_attenuation_per_m
from radron.sim.radiation.electronics import FLIP_COLUMN, FLIP_ROW, SWAP
from radron.sim.radiation.ground.areafield import PLACES, area_field
from radron.sim.radiation.ground.bank import COLUMNS, DIRECTIONS, ROWS
from radron.sim.radiation.ground.materials import concrete_per
from radron.sim.radiation.ground.photons import AROUND, GROUPS, TOWARDS
from radron.sim.radiation.materials import air_attenuation_per_m
from radron.sim.radiation.nuclides import nuclide
from radron.sim.radiation.truth import GroundTruth

if TYPE_CHECKING:
    from radron.sim.radiation.emission import Emission
    from radron.sim.radiation.individual import Individual

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MIN_HEIGHT_M = 0.3  # of a camera above a cell: below it, a cell is no point even on average
_SYMMETRIES = 8
_OCTANT = 0.25 * math.pi


class AreaSource(Struct, frozen=True):
    """Contaminated ground of one nuclide, in square cells with an even activity.

    x_m, y_m: (N,) centres of the cells in the world; the ground is flat, at z = 0. activity_bq: (N,). cell_m: side of a cell.
    """

    nuclide: str
    x_m: FloatArray
    y_m: FloatArray
    activity_bq: FloatArray
    cell_m: float


class AreaPose(NamedTuple):
    """Pose of a camera above contaminated ground.

    position_m: (3,) in the world, the last one above the ground. camera_from_world: (3, 3) rotation.
    """

    position_m: FloatArray
    camera_from_world: FloatArray


class AreaView(NamedTuple):
    """Photons of one contaminated area at a camera in one time slice.

    bins, symmetries, rates: (N,) of each cell's unscattered photons: direction bin, symmetry of the sensor, events (1/s) if all
    lines were weakened as the most penetrating one. excess: (N, lines) optical depths beyond that line's. near: rate of all of
    them if vehicle and camera shadowed none. towards: (symmetries, DIRECTIONS, GROUPS) flux of scattered photons from the cells'
    side; around: (GROUPS,) from all sides; per m2 and s.
    """

    bins: IntArray
    symmetries: IntArray
    rates: FloatArray
    excess: FloatArray
    near: float
    towards: FloatArray
    around: FloatArray


class AreaInCamera:
    """Computes the photons of one contaminated area that reach one camera.

    Each cell counts as a point, moved from its centre by an offset that the caller draws anew for each time slice and for all
    cells: rates are thus integrals over the cells on average, without finer cells below a low camera.
    """

    def __init__(self, area: AreaSource, emission: Emission, ground: GroundTruth, own: Individual) -> None:
        self._area = area
        self._ground = ground
        self._field = area_field(area.nuclide, ground.kind, ground.depth_m)
        self._own = own
        self._mm2 = np.array(emission.area_mm2[:DIRECTION_BINS])
        self._transmission = _transmissions(own)

    def see(self, pose: AreaPose, offset: tuple[float, float]) -> AreaView:
        """Return the photons at a pose of the camera. ``offset``: place of each cell in its square, from 0 to 1 of its side."""
        area, own = self._area, self._own
        camera, height_m = _shifted(area, self._ground, pose.position_m, offset)
        cells = (area.x_m, area.y_m, area.activity_bq)
        bins, symmetries, distance_m, towards, around = _look(
            *cells, camera, height_m, pose.camera_from_world, *_fine_rows(), self._transmission, PLACES
        )
        depths = distance_m[:, None] * _depth_per_m(area.nuclide, self._ground, height_m)
        least = depths.min(axis=1)
        per_mm2 = area.activity_bq * np.exp(-least) / (4e6 * math.pi * distance_m * distance_m)
        rates = own.sensitivity * per_mm2 * self._mm2[bins]
        flux = own.sensitivity * self._field.at(height_m)[:, :, :GROUPS]
        return AreaView(
            bins=bins,
            symmetries=symmetries,
            rates=rates * self._transmission[bins, symmetries],
            excess=depths - least[:, None],
            near=float(rates.sum()),
            towards=towards @ flux[:, TOWARDS],
            around=around @ flux[:, AROUND],
        )


def flux_by_angle(
    area: AreaSource, ground: GroundTruth, position_m: FloatArray, offset: tuple[float, float], angles_deg: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the flux of an area's photons by the angle of their cells to straight below, for a detector without azimuth.

    The results, per m2 and s: (A, L) straight from the cells by line, (A, GROUPS) scattered from their side, (GROUPS,) from
    all sides. ``position_m``: of the detector; ``offset``: as for ``AreaInCamera.see``. angles_deg: (A,) from 0 to 90, evenly
    spaced; a cell between two of them counts for both.
    """
    place, height_m = _shifted(area, ground, position_m, offset)
    radius = np.hypot(area.x_m - place[0], area.y_m - place[1])
    square = radius**2 + place[2] ** 2
    per_m2 = area.activity_bq / (4.0 * math.pi * square)
    by_angle = _shares(np.degrees(np.arctan2(radius, place[2])), angles_deg)  # (N, A)
    by_ring = _shares(np.arcsinh(radius / height_m), PLACES)  # (N, R)
    intensity = np.array([share for _, share in nuclide(area.nuclide).lines])
    reach = np.exp(-np.sqrt(square)[:, None] * _depth_per_m(area.nuclide, ground, height_m)) * intensity
    field = area_field(area.nuclide, ground.kind, ground.depth_m).at(height_m)[:, :, :GROUPS]
    weighted = by_angle * per_m2[:, None]
    return weighted.T @ reach, weighted.T @ by_ring @ field[:, TOWARDS], per_m2 @ by_ring @ field[:, AROUND]


def _shares(values: FloatArray, places: FloatArray) -> FloatArray:
    """(N, P): weights of linear interpolation of N values between rising places, and of the outermost ones beyond them."""
    cell = np.clip(np.searchsorted(places, values) - 1, 0, len(places) - 2)
    part = np.clip((values - places[cell]) / (places[cell + 1] - places[cell]), 0.0, 1.0)
    shares = np.zeros((len(values), len(places)))
    rows = np.arange(len(values))
    shares[rows, cell], shares[rows, cell + 1] = 1.0 - part, part
    return shares


def _shifted(
    area: AreaSource, ground: GroundTruth, position_m: FloatArray, offset: tuple[float, float]
) -> tuple[FloatArray, float]:
    """Position of a detector (3,) relative to the centres of cells that are moved by an offset, and its height."""
    x, y, z = position_m.tolist()
    height_m = max(z, MIN_HEIGHT_M)
    east, north = ((part - 0.5) * area.cell_m for part in offset)
    return np.array((x - east, y - north, height_m + ground.depth_m)), height_m


def _depth_per_m(nuclide_name: str, ground: GroundTruth, height_m: float) -> FloatArray:
    """(L,) optical depth of each line per metre of way, through soil and air."""
    air, soil = _attenuations(nuclide_name)
    buried_m = ground.depth_m
    return np.asarray((air * height_m + concrete_per(ground.kind) * soil * buried_m) / (height_m + buried_m))


@cache
def _attenuations(nuclide_name: str) -> tuple[FloatArray, FloatArray]:
    """Attenuation of a nuclide's lines in air and in concrete, (L,) each, per metre."""
    energies = [energy for energy, _ in nuclide(nuclide_name).lines]
    air = np.array([air_attenuation_per_m(energy) for energy in energies])
    return air, np.array([concrete_attenuation_per_m(energy) for energy in energies])


def _transmissions(own: Individual) -> FloatArray:
    """(DIRECTION_BINS, symmetries): share of the photons of each direction that this camera counts."""
    centres = bin_centres()
    turned = [np.array([_turned(x, y, z, symmetry) for x, y, z in centres.tolist()]) for symmetry in range(_SYMMETRIES)]
    return np.array([[own.transmission(tuple(unit)) for unit in units.tolist()] for units in turned]).T


def _turned(x: float, y: float, z: float, symmetry: int) -> tuple[float, float, float]:
    """The direction that a symmetry of the sensor makes of one in the first octant."""
    if symmetry & SWAP:
        x, y = y, x
    return -x if symmetry & FLIP_COLUMN else x, -y if symmetry & FLIP_ROW else y, z


@cache
def _fine_rows() -> tuple[IntArray, IntArray]:
    """First bin and number of bins of each row of directions of one polar angle, as of ``bank.bin_of``."""
    _, first, count = np.unique(-bin_centres()[:, 2].round(9), return_index=True, return_counts=True)
    return first.astype(np.int64), count.astype(np.int64)


@jit
def _look(
    x_m: FloatArray,
    y_m: FloatArray,
    activity_bq: FloatArray,
    camera_m: FloatArray,
    height_m: float,
    turn: FloatArray,
    first: IntArray,
    count: IntArray,
    transmission: FloatArray,
    places: FloatArray,
) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray]:
    """Directions and distances of all cells, and what weighs the table of scattered photons.

    The results are the cells' direction bins, symmetries and distances, (N,) each, and the sums over the cells of activity
    / (4 pi D^2) by ring: (symmetries, DIRECTIONS, R) with the camera's transmission, and (R,) without.
    """
    cells = len(x_m)
    bins, symmetries, distances = np.empty(cells, np.int64), np.empty(cells, np.int64), np.empty(cells)
    towards, around = np.zeros((_SYMMETRIES, DIRECTIONS, len(places))), np.zeros(len(places))
    for k in range(cells):
        dx, dy, dz = x_m[k] - camera_m[0], y_m[k] - camera_m[1], -camera_m[2]
        square = dx * dx + dy * dy + dz * dz
        distance = math.sqrt(square)
        u = (turn[0, 0] * dx + turn[0, 1] * dy + turn[0, 2] * dz) / distance
        v = (turn[1, 0] * dx + turn[1, 1] * dy + turn[1, 2] * dz) / distance
        w = (turn[2, 0] * dx + turn[2, 1] * dy + turn[2, 2] * dz) / distance
        symmetry = (FLIP_COLUMN if u < 0.0 else 0) | (FLIP_ROW if v < 0.0 else 0)
        u, v = abs(u), abs(v)
        if v > u:
            symmetry |= SWAP
            u, v = v, u
        polar = math.acos(max(-1.0, min(1.0, w))) / math.pi
        azimuth = math.atan2(v, u) / _OCTANT
        row = min(len(count) - 1, int(polar * len(count)))
        place = first[row] + min(count[row] - 1, int(azimuth * count[row]))
        coarse = min(ROWS - 1, int(polar * ROWS)) * COLUMNS + min(COLUMNS - 1, int(azimuth * COLUMNS))
        bins[k], symmetries[k], distances[k] = place, symmetry, distance
        weight = activity_bq[k] / (4.0 * math.pi * square)
        seen = weight * transmission[place, symmetry]
        value = math.asinh(math.sqrt(dx * dx + dy * dy) / height_m)
        ring = min(max(int(np.searchsorted(places, value)) - 1, 0), len(places) - 2)
        share = min(max((value - places[ring]) / (places[ring + 1] - places[ring]), 0.0), 1.0)
        towards[symmetry, coarse, ring] += (1.0 - share) * seen
        towards[symmetry, coarse, ring + 1] += share * seen
        around[ring] += (1.0 - share) * weight
        around[ring + 1] += share * weight
    return bins, symmetries, distances, towards, around
