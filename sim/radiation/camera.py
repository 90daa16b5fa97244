"""The simulated camera of a drone: from sources in view to pixel hits. It is fast, as it draws from stored events."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from radron.agent.detector.readout import Readout
from radron.sim.radiation.bank import BACKGROUND_BIN, SCATTERED_BIN, near_bin
from radron.sim.radiation.calibration import PixelCalibration
from radron.sim.radiation.electronics import Electronics
from radron.sim.radiation.emission import FROM_ALL_DIRECTIONS, Emission, Origins, Pool, pick
from radron.sim.radiation.ground.area import AreaInCamera, AreaPose, AreaSource, AreaView
from radron.sim.radiation.ground.around import MIN_DISTANCE_M, AroundCamera
from radron.sim.radiation.individual import Individual
from radron.sim.radiation.truth import CameraTruth, GroundTruth

__all__ = ["Camera", "CameraTruth", "SourceView"]

GUARD_TICKS = 128  # an event's hits end within 200 ns; the last events of a slice begin early enough to end in it


class SourceView(Struct, frozen=True):
    """A source as a camera sees it, from the camera's true position and attitude.

    direction: unit vector from camera to source, camera frame. concrete_m: length of concrete between them. nuclide: one of the
    camera's nuclides; empty: its first. camera_m, source_m: heights above the ground at the source, which count where photons of
    the ground are simulated.
    """

    direction: tuple[float, float, float]
    distance_m: float
    activity_bq: float
    concrete_m: float = 0.0
    nuclide: str = ""
    camera_m: float = 0.0
    source_m: float = 0.0


class _Rates(NamedTuple):
    """Origins of photons as ``Origins`` has them, with their rates (1/s)."""

    bins: Sequence[int] | NDArray[np.int64]
    nuclide: Sequence[int] | NDArray[np.int64]
    symmetries: Sequence[int] | NDArray[np.int64]
    rates: Sequence[float] | NDArray[np.float64]


def _of_area(nuclide: int, area: AreaView) -> _Rates:
    return _Rates(area.bins, np.full(len(area.bins), nuclide), area.symmetries, area.rates)


class Camera:
    """A simulated MiniPIX TPX3 (pixel detector) exposed to sources, with background, scattered photons, air and electronics.

    Concrete and the vehicle's body attenuate the direct photons, and the photons that the ground scatters from about the source's
    direction. All other scattered photons come from all directions.

    Args:
        truth: the camera's true parameters.
        nuclides: nuclides of the sources, each once.
        rng: the camera's own random numbers.
        clock_ns: UTC time of tick 0, the start of the simulation.
        ground: material below the drone; None: no ground, as in the paper's data.
        areas: contaminated parts of the ground, of some of these nuclides.

    Raises:
        ConfigError: an unknown nuclide.
        ValueError: contaminated parts of no ground.
    """

    def __init__(
        self,
        truth: CameraTruth,
        nuclides: str | Sequence[str],
        rng: np.random.Generator,
        clock_ns: int,
        ground: GroundTruth | None = None,
        areas: Sequence[AreaSource] = (),
    ) -> None:
        self._truth = truth
        self._clock_ns = clock_ns
        self._rng = rng
        self._emissions = [Emission(nuclide, truth) for nuclide in ([nuclides] if isinstance(nuclides, str) else nuclides)]
        self._place = {emission.nuclide: place for place, emission in enumerate(self._emissions)} | {"": 0}
        self._lines = max(emission.lines for emission in self._emissions)
        self._around = None if ground is None else AroundCamera(ground, truth)
        self._pools: list[Pool] = [*self._emissions, *([] if self._around is None else [self._around])]
        self._own = Individual(truth, rng)
        self._areas = [self._in_camera(area, ground) for area in areas]
        self._electronics = Electronics(truth, rng, clock_ns)
        # Records no event, but loads the compiled functions, which takes longer than a second of exposures.
        nowhere = Origins(
            np.array([1.0]),
            np.array([BACKGROUND_BIN]),
            np.array([0]),
            np.array([FROM_ALL_DIRECTIONS]),
            np.empty((0, self._lines)),
        )
        self._record(clock_ns, clock_ns, np.empty((0, 5)), nowhere)

    def _in_camera(self, area: AreaSource, ground: GroundTruth | None) -> tuple[int, AreaInCamera]:
        """An area with the place of its nuclide."""
        if ground is None:
            raise ValueError("contaminated ground needs a ground")
        place = self._place[area.nuclide]
        return place, AreaInCamera(area, self._emissions[place], ground, self._own)

    @property
    def calibration(self) -> PixelCalibration:
        """The camera's energy calibration, with ``write(folder)`` for the agent's files."""
        return self._electronics.calibration

    def expose(
        self, start_ns: int, end_ns: int, views: Sequence[SourceView], height_m: float = 0.0, pose: AreaPose | None = None
    ) -> Readout:
        """Return all pixel hits from ``start_ns`` until before ``end_ns`` (UTC); the number of photons is Poisson distributed.

        ``views``: the sources, which do not move relative to the camera meanwhile. ``height_m``: height of the camera above the
        ground below it. ``pose``: pose of the camera, which counts for contaminated ground alone; without it none is seen. A
        clock offset of the camera shifts all stamps of the readout equally.
        """
        rng, truth, own = self._rng, self._truth, self._own
        bins: list[int] = []
        nuclides: list[int] = []
        symmetries: list[int] = []
        rates: list[float] = []
        excess = np.zeros((len(views), self._lines))
        scattered = [0.0] * len(self._emissions)
        for k, view in enumerate(views):
            nuclide = self._place[view.nuclide]
            emission = self._emissions[nuclide]
            distance_m = max(view.distance_m, MIN_DISTANCE_M)
            place, symmetry = near_bin(view.direction, rng.random(), rng.random())
            depth = emission.least_attenuation * distance_m
            per_mm2 = view.activity_bq * math.exp(-depth) / (4e6 * math.pi * distance_m * distance_m)
            rate = own.sensitivity * per_mm2 * emission.area_mm2[place]
            depths = emission.depths(distance_m, view.concrete_m)
            least = min(depths)
            excess[k, : emission.lines] = [depth - least for depth in depths]
            bins.append(place)
            nuclides.append(nuclide)
            symmetries.append(symmetry)
            rates.append(rate * own.transmission(view.direction) * math.exp(depth - least))
            scattered[nuclide] += rate * (truth.scatter_near + (truth.scatter_air * depth if self._around is None else 0.0))
        areas = [] if pose is None else [(place, one.see(pose, (rng.random(), rng.random()))) for place, one in self._areas]
        for place, area in areas:
            scattered[place] += area.near * truth.scatter_near
        straight = _Rates(bins, nuclides, symmetries, rates)
        span_s = (end_ns - start_ns) * 1e-9
        drift = own.background(span_s)
        everywhere = _Rates(
            [SCATTERED_BIN] * len(scattered) + [BACKGROUND_BIN],
            [*range(len(scattered)), 0],
            [FROM_ALL_DIRECTIONS] * (len(scattered) + 1),
            [*scattered, truth.background_hits_per_s * own.sensitivity * drift],
        )
        parts = [straight, *(_of_area(place, area) for place, area in areas), everywhere]
        if self._around is not None:
            time_s = (start_ns - self._clock_ns) * 1e-9
            first = self._emissions[0].nuclide
            around = self._around.rates(views, [area for _, area in areas], own, drift, height_m, time_s, first)
            parts.append(_Rates(around.bins, np.full(len(around.bins), len(self._emissions)), around.symmetries, around.rates))
        cumulative = np.cumsum(np.concatenate([part.rates for part in parts]))
        count = int(rng.poisson(cumulative[-1] * span_s))
        if count == 0:
            return self._stamped(self._electronics.empty(start_ns, end_ns))
        origins = Origins(
            cumulative,
            np.concatenate([part.bins for part in parts]).astype(np.int64),
            np.concatenate([part.nuclide for part in parts]).astype(np.int64),
            np.concatenate([part.symmetries for part in parts]).astype(np.int64),
            self._excess(excess, [area for _, area in areas]),
        )
        return self._stamped(self._record(start_ns, end_ns, rng.random((count, 5)), origins))

    def _excess(self, of_views: NDArray[np.float64], areas: Sequence[AreaView]) -> NDArray[np.float64]:
        """Optical depths of all sources and cells of contaminated ground beyond their most penetrating line's."""
        padded = [np.pad(area.excess, ((0, 0), (0, self._lines - area.excess.shape[1]))) for area in areas]
        return np.concatenate([of_views, *padded])

    def _stamped(self, readout: Readout) -> Readout:
        """The readout with the stamps of the camera's own clock."""
        offset_ns = self._own.clock_offset_ns
        if offset_ns == 0:
            return readout
        start_ns, end_ns, clock_ns = (time + offset_ns for time in (readout.start_ns, readout.end_ns, readout.clock_ns))
        return replace(readout, start_ns=start_ns, end_ns=end_ns, clock_ns=clock_ns)

    def _record(self, start_ns: int, end_ns: int, u: NDArray[np.float64], origins: Origins) -> Readout:
        """Hits of as many events as ``u`` (N, 5) has rows of uniform numbers."""
        first_tick, last_tick = self._electronics.ticks(start_ns, end_ns)
        picked = pick(self._pools, u, origins, first_tick, max(1, last_tick - GUARD_TICKS - first_tick))
        return self._electronics.read_out(start_ns, end_ns, *picked)
