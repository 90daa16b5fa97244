"""The simulated camera: from sources in view to a readout, fast, from the event bank."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from agent.detector.readout import Readout
from sim.radiation._jit import jit
from sim.radiation.bank import BACKGROUND_BIN, SCATTERED_BIN, near_bin
from sim.radiation.calibration import PixelCalibration
from sim.radiation.concrete import concrete_attenuation_per_m
from sim.radiation.electronics import Electronics
from sim.radiation.events import KINDS
from sim.radiation.individual import Individual
from sim.radiation.materials import air_attenuation_per_m
from sim.radiation.nuclides import nuclide as nuclide_of
from sim.radiation.store import load_bank
from sim.radiation.truth import CameraTruth

__all__ = ["Camera", "CameraTruth", "SourceView"]

GUARD_TICKS = 128  # an event's hits end within 200 ns; the last events of a slice begin early enough to end in it
_NEAREST_M = 0.05


class SourceView(Struct, frozen=True):
    """A source as a camera sees it at its true pose. direction: unit vector from camera to source, camera frame.

    concrete_m: length of concrete between them.
    """

    direction: tuple[float, float, float]
    distance_m: float
    activity_bq: float
    concrete_m: float = 0.0


class Camera:
    """A MiniPIX TPX3 exposed to sources of one nuclide, with background, scatter, air and electronics.

    Concrete and the vehicle's body attenuate the direct photons only: scattered photons come from all directions.

    Args:
        truth: the camera's true parameters.
        nuclide: of all sources.
        rng: the camera's own random numbers.
        clock_ns: UTC time of tick 0.

    Raises:
        ConfigError: an unknown nuclide.
    """

    def __init__(self, truth: CameraTruth, nuclide: str, rng: np.random.Generator, clock_ns: int) -> None:
        lines = nuclide_of(nuclide).lines
        self._truth = truth
        self._rng = rng
        self._bank = load_bank(nuclide, truth)
        self._area_mm2: list[float] = self._bank.area_mm2.sum(axis=1).tolist()
        total = np.maximum(self._bank.area_mm2.sum(axis=1, keepdims=True), 1e-30)
        self._kind = np.ascontiguousarray(np.cumsum(self._bank.area_mm2, axis=1) / total)
        self._attenuation = [air_attenuation_per_m(energy) for energy, _ in lines]
        self._least_attenuation = min(self._attenuation)
        self._concrete = [concrete_attenuation_per_m(energy) for energy, _ in lines]
        self._own = Individual(truth, rng)
        self._electronics = Electronics(truth, rng, clock_ns)
        # Records no event, but loads the compiled functions, which takes longer than a second of exposures.
        self._record(clock_ns, clock_ns, np.empty((0, 5)), [1.0], [BACKGROUND_BIN], [], np.empty((0, len(lines))))

    @property
    def calibration(self) -> PixelCalibration:
        """The camera's own, with ``write(folder)`` for the agent's files."""
        return self._electronics.calibration

    def expose(self, start_ns: int, end_ns: int, views: Sequence[SourceView]) -> Readout:
        """All hits of [start_ns, end_ns), UTC, with the sources at ``views`` throughout; their number is Poisson distributed.

        A clock offset shifts all stamps of the readout by the same time.
        """
        rng, truth, own = self._rng, self._truth, self._own
        bins: list[int] = []
        symmetries: list[int] = []
        rates: list[float] = []
        excess = np.empty((len(views), len(self._attenuation)))  # optical depth of each line beyond the least one
        scattered = 0.0
        for k, view in enumerate(views):
            distance_m = max(view.distance_m, _NEAREST_M)
            place, symmetry = near_bin(view.direction, rng.random(), rng.random())
            depth = self._least_attenuation * distance_m
            per_mm2 = view.activity_bq * math.exp(-depth) / (4e6 * math.pi * distance_m * distance_m)
            rate = own.sensitivity * per_mm2 * self._area_mm2[place]
            lines = zip(self._attenuation, self._concrete, strict=True)
            depths = [air * distance_m + concrete * view.concrete_m for air, concrete in lines]
            least = min(depths)
            excess[k] = [depth - least for depth in depths]
            bins.append(place)
            symmetries.append(symmetry)
            rates.append(rate * own.body_transmission(view.direction) * math.exp(depth - least))
            scattered += rate * (truth.scatter_near + truth.scatter_air * depth)
        span_s = (end_ns - start_ns) * 1e-9
        bins += (SCATTERED_BIN, BACKGROUND_BIN)
        rates += (scattered, truth.background_hits_per_s * own.sensitivity * own.background(span_s))
        cumulative = list(accumulate(rates))
        count = int(rng.poisson(cumulative[-1] * span_s))
        if count == 0:
            return self._stamped(self._electronics.empty(start_ns, end_ns))
        return self._stamped(self._record(start_ns, end_ns, rng.random((count, 5)), cumulative, bins, symmetries, excess))

    def _stamped(self, readout: Readout) -> Readout:
        """The readout with the stamps of the camera's own clock."""
        offset_ns = self._own.clock_offset_ns
        if offset_ns == 0:
            return readout
        start_ns, end_ns, clock_ns = (time + offset_ns for time in (readout.start_ns, readout.end_ns, readout.clock_ns))
        return replace(readout, start_ns=start_ns, end_ns=end_ns, clock_ns=clock_ns)

    def _record(
        self,
        start_ns: int,
        end_ns: int,
        u: NDArray[np.float64],
        cumulative: list[float],
        bins: list[int],
        symmetries: list[int],
        excess: NDArray[np.float64],
    ) -> Readout:
        """Hits of as many events as ``u`` (N, 5) has rows of uniform numbers; the lists hold one item for each view, then for
        scatter and background (without a symmetry, which is drawn for each event). ``excess`` (views, lines): optical depth
        of what lies between, beyond that of the most penetrating line."""
        bank = self._bank
        first_tick, last_tick = self._electronics.ticks(start_ns, end_ns)
        event, symmetry, tick = _pick(
            u,
            np.array(cumulative),
            np.array(bins),
            np.array(symmetries, np.int64),
            excess,
            self._kind,
            bank.start,
            bank.count,
            bank.line,
            first_tick,
            max(1, last_tick - GUARD_TICKS - first_tick),
        )
        return self._electronics.read_out(start_ns, end_ns, bank.pixels, bank.first, event, symmetry, tick)


@jit
def _pick(
    u: NDArray[np.float64],
    cumulative: NDArray[np.float64],
    bins: NDArray[np.int64],
    symmetries: NDArray[np.int64],
    excess: NDArray[np.float64],
    kind_cumulative: NDArray[np.float64],
    start: NDArray[np.int64],
    count: NDArray[np.int64],
    line: NDArray[np.uint8],
    first_tick: int,
    ticks: int,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Draw events: (N,) bank indices, symmetries and ticks from (N, 5) uniform numbers.

    The rates include the transmission of the most penetrating line; events of other lines are thinned out to theirs.
    """
    event = np.empty(len(u), np.int64)
    symmetry = np.empty(len(u), np.int64)
    tick = np.empty(len(u), np.int64)
    size = 0
    for n in range(len(u)):
        origin = min(np.searchsorted(cumulative, u[n, 0] * cumulative[-1], side="right"), len(bins) - 1)
        place = bins[origin]
        kind = 0
        while kind < KINDS - 1 and u[n, 1] >= kind_cumulative[place, kind]:
            kind += 1
        if count[place, kind] == 0:
            continue
        chosen = start[place, kind] + int(u[n, 2] * count[place, kind])
        if origin < len(symmetries):
            keep = np.exp(-excess[origin, line[chosen]])
            symmetry[size] = symmetries[origin]
        else:
            keep = 1.0
            symmetry[size] = int(8.0 * u[n, 4])
        if keep < 1.0 and u[n, 4] >= keep:
            continue
        event[size] = chosen
        tick[size] = first_tick + int(u[n, 3] * ticks)
        size += 1
    return event[:size], symmetry[:size], tick[:size]
