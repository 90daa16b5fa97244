"""Counts of a detector above contaminated ground: of a point of the ground, and of each cell of a grid.

A becquerel at the place q gives a detector at p, per second and in channel c, U_c(q - p) counts by photons straight from the
ground, and S_c(q - p) by photons that soil, air and vehicle have scattered. A cell of side a gives their means over the cell,

    U_j = (1 / a^2) integral of U over cell j,

by its middle, or by 2 x 2 points within ``NEAR`` heights. The ground is level below each detector.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from radron.agent.fusion.bayes.response import MIN_SOURCE_DISTANCE_M, REFERENCE_BQ, Response
from radron.agent.fusion.facing import Facing
from radron.agent.fusion.field.grid import Grid
from radron.agent.fusion.field.sums import Sums
from radron.agent.fusion.observation import CountObservation
from radron.agent.geometry import Array

Floats = NDArray[np.float32]

NEAR: Final = 3.0  # horizontal distance of a cell in heights, up to which it is more than a point
_CHUNK: Final = 64  # rows at once: a few megabytes


class Detector(Protocol):
    """A kind of detector, as the kernels need it: its background, its exposures, and its counts of ground."""

    @property
    def background_ps(self) -> Array:
        """(C,) counts by channel, per second, without contamination."""

    def fits(self, observation: CountObservation) -> bool:
        """Return whether an exposure is of this kind of detector."""

    def counted(self, observation: CountObservation) -> tuple[int, ...]:
        """Return the C counts of an exposure."""

    def per_bq(self, east: Array, north: Array, height: Array, twice: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return U and S, (..., C) counts per second of a becquerel on the ground.

        east, north: (...) from the detector to the place, height: (...) of the detector above the ground, metres. twice: (...)
        means of cos 2 psi and sin 2 psi, psi the heading.
        """


@dataclass(frozen=True, eq=False)
class MiniPix:
    """The camera, by the tables of ``bayes``: partial-energy and full-energy events of one nuclide."""

    response: Response

    @property
    def background_ps(self) -> Array:
        """(2,) events per second without contamination."""
        return self.response.background_ps

    def fits(self, observation: CountObservation) -> bool:
        """Return whether an exposure is of a camera."""
        return not observation.bins

    def counted(self, observation: CountObservation) -> tuple[int, ...]:
        """Return the partial-energy and full-energy events of an exposure."""
        partial, full = Response.apart(observation.counts).tolist()
        return round(partial), round(full)

    def per_bq(self, east: Array, north: Array, height: Array, twice: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return U and S of ``Detector.per_bq``."""
        response = self.response
        distance = np.sqrt(np.maximum(east * east + north * north + height * height, MIN_SOURCE_DISTANCE_M**2))
        fluence = response.flux(distance) / REFERENCE_BQ
        facing = Facing.of(east, north, distance, *twice).cosine()
        soil = response.over_soil
        by_soil = None if soil is None else soil.by_soil(fluence, height / distance, facing)
        return response.parts(fluence, distance, facing, by_soil)


@dataclass(frozen=True, eq=False)
class Mixed:
    """The detectors of a mixed swarm, with the same channels. drones: ids; each: (D,) their detectors."""

    drones: tuple[str, ...]
    each: tuple[Detector, ...]

    @property
    def background_ps(self) -> Array:
        """(C,) of the first detector; see ``backgrounds``."""
        return self.each[0].background_ps

    def fits(self, observation: CountObservation) -> bool:
        """Return whether an exposure is of its drone's kind of detector."""
        return self._of(observation).fits(observation)

    def counted(self, observation: CountObservation) -> tuple[int, ...]:
        """Return the C counts of an exposure."""
        return self._of(observation).counted(observation)

    def _of(self, observation: CountObservation) -> Detector:
        return self.each[self.drones.index(observation.identity.drone)]


AnyDetector = Detector | Mixed


def backgrounds(detector: AnyDetector, drone: NDArray[np.int64]) -> Array:
    """Return the counts of sums without contamination, (R, C) per second. drone: (R,) numbers of the drones."""
    result = np.empty((len(drone), len(detector.background_ps)))
    for kind, rows in _by_kind(detector, drone):
        result[rows] = kind.background_ps
    return result


def _by_kind(detector: AnyDetector, drone: NDArray[np.int64]) -> Iterator[tuple[Detector, NDArray[np.intp]]]:
    """Each kind of detector, with the rows of its drones."""
    if not isinstance(detector, Mixed):
        yield detector, np.arange(len(drone))
        return
    for kind in {id(one): one for one in detector.each}.values():
        yield kind, np.flatnonzero(np.array([one is kind for one in detector.each])[drone])


@dataclass(frozen=True, eq=False)
class Kernels:
    """Kernels of R sums: direct, scattered: (R, C, N) counts per second of a becquerel per m2 in each of the grid's N cells;
    beyond: (2, R, C) the same of all ground beyond the grid.
    """

    direct: Floats
    scattered: Floats
    beyond: Array

    def __len__(self) -> int:
        return len(self.direct)

    @cached_property
    def every(self) -> Floats:
        """(R, C, N) counts by direct and scattered photons."""
        return self.direct + self.scattered


def kernels_of(sums: Sums, height: Array, grid: Grid, detector: AnyDetector) -> Kernels:
    """Compute the kernels of sums; height: (R,) of the detectors above the ground, metres."""
    rows, channels = len(sums), len(detector.background_ps)
    result = np.zeros((2, rows, channels, grid.size), np.float32)
    beyond = np.zeros((2, rows, channels))
    for kind, own in _by_kind(detector, sums.drone):
        for start in range(0, len(own), _CHUNK):
            part = own[start : start + _CHUNK]
            views = sums.place[part], height[part], sums.facing[part]
            here = _of_cells(views, grid.centres, kind, grid.cell_m)
            far = _points(views, grid.beyond, kind)
            for way in range(2):
                result[way, part] = np.moveaxis(here[way], 2, 1) * grid.cell_m**2
                beyond[way, part] = np.einsum("rnc,n->rc", far[way], grid.beyond_m2)
    return Kernels(result[0], result[1], beyond)


Views = tuple[Array, Array, Array]  # places (R, 3), heights (R,) and facings (R, 2) of detectors


def _points(views: Views, places: Array, detector: Detector) -> tuple[Array, Array]:
    """Return (R, N, C) U and S of N points (N, 2)."""
    place, height, facing = views
    off = places[None] - place[:, None, :2]
    twice = facing[:, 0, None], facing[:, 1, None]
    return detector.per_bq(off[..., 0], off[..., 1], height[:, None], twice)


def _of_cells(views: Views, centres: Array, detector: Detector, cell_m: float) -> tuple[Array, Array]:
    """Return (R, N, C) means of U and S over N cells with these centres (N, 2)."""
    direct, scattered = _points(views, centres, detector)
    place, height, facing = views
    off = centres[None] - place[:, None, :2]
    row, cell = np.nonzero((off * off).sum(axis=2) < (NEAR * height[:, None]) ** 2)
    quarter = 0.25 * cell_m * np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
    near = off[row, cell][:, None, :] + quarter
    twice = facing[row, 0, None], facing[row, 1, None]
    by_part = detector.per_bq(near[..., 0], near[..., 1], height[row, None], twice)
    direct[row, cell], scattered[row, cell] = (part.mean(axis=1) for part in by_part)
    return direct, scattered


class KernelStore:
    """Kernels of sums, each computed once: they are functions of a sum alone."""

    def __init__(self, grid: Grid, detector: AnyDetector) -> None:
        self._grid, self._detector = grid, detector
        self._place: dict[bytes, int] = {}
        none = np.zeros((0, len(detector.background_ps), grid.size), np.float32)
        self._kept = Kernels(none, none, np.zeros((2, 0, 0)))

    def of(self, sums: Sums, height: Array) -> Kernels:
        """Return the kernels of these sums, and forget all others. height: (R,) above the ground, metres."""
        keys = [row.tobytes() for row in sums.table]
        missing = [place for place, key in enumerate(keys) if key not in self._place]
        if not missing and len(keys) == len(self._place):
            return self._kept
        fresh = kernels_of(Sums(sums.table[missing]), height[missing], self._grid, self._detector)
        known = [place for place, key in enumerate(keys) if key in self._place]
        old = [self._place[keys[place]] for place in known]
        shape = (len(keys), len(self._detector.background_ps), self._grid.size)
        parts = []
        for before, new in ((self._kept.direct, fresh.direct), (self._kept.scattered, fresh.scattered)):
            part = np.empty(shape, np.float32)
            part[known], part[missing] = before[old], new
            parts.append(part)
        beyond = np.empty((2, *shape[:2]))
        if known:
            beyond[:, known] = self._kept.beyond[:, old]
        beyond[:, missing] = fresh.beyond
        self._kept, self._place = Kernels(parts[0], parts[1], beyond), {key: place for place, key in enumerate(keys)}
        return self._kept
