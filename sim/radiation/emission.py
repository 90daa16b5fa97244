"""Choice of the events that a camera sees: at random from stored events, by the rates of the photons' origins."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from radron.sim.radiation._jit import jit
from radron.sim.radiation.bank import EventBank
from radron.sim.radiation.concrete import concrete_attenuation_per_m
from radron.sim.radiation.events import KINDS
from radron.sim.radiation.materials import air_attenuation_per_m
from radron.sim.radiation.nuclides import nuclide as nuclide_of
from radron.sim.radiation.store import load_bank
from radron.sim.radiation.truth import CameraTruth

IntArray = NDArray[np.int64]

FROM_ALL_DIRECTIONS = -1  # symmetry: from all directions


class Picked(NamedTuple):
    """N simulated events that were chosen to be read out.

    pixels, first: pixels of all stored events, and index of each one's first pixel. event: (N,) indices into ``first``. symmetry:
    (N,) symmetry of the sensor applied to each event. tick: (N,) clock tick of each event.
    """

    pixels: NDArray[np.void]
    first: IntArray
    event: IntArray
    symmetry: IntArray
    tick: IntArray


class Origins(NamedTuple):
    """The O possible origins of photons in one time slice: sources, scattered photons of each nuclide, background and ground.

    cumulative: (O,) cumulated rates. bins: (O,) direction bins of the stored events. nuclide: (O,) index of the set of events.
    symmetries: (O,) symmetry of the sensor applied to an event; ``FROM_ALL_DIRECTIONS``: a random one for each event. excess:
    optical depth of air and concrete for each gamma line, minus the optical depth of the most penetrating line.
    """

    cumulative: NDArray[np.float64]
    bins: IntArray
    nuclide: IntArray
    symmetries: IntArray
    excess: NDArray[np.float64]


class Pool:
    """A bank of stored simulated events, from which the events that a camera sees are chosen at random.

    area_mm2: effective area of each direction bin.
    """

    def __init__(self, bank: EventBank) -> None:
        self._bank = bank
        area = bank.area_mm2.sum(axis=1)
        self.area_mm2: list[float] = area.tolist()
        self._kind = np.ascontiguousarray(np.cumsum(bank.area_mm2, axis=1) / np.maximum(area[:, None], 1e-30))

    def pick(self, u: NDArray[np.float64], origin: IntArray, origins: Origins, first_tick: int, ticks: int) -> Picked:
        """Choose N stored events at random.

        u: (N, 5) uniform random numbers. origin: (N,) index of each event's origin in ``origins``. first_tick, ticks: begin and
        length of the exposure in clock ticks.
        """
        bank = self._bank
        event, symmetry, tick = _pick(
            u,
            origin,
            origins.bins,
            origins.symmetries,
            origins.excess,
            self._kind,
            bank.start,
            bank.count,
            bank.line,
            first_tick,
            ticks,
        )
        return Picked(bank.pixels, bank.first, event, symmetry, tick)


class Emission(Pool):
    """The photons of one nuclide as one camera can see them: stored events, and attenuation in air and concrete.

    area_mm2: effective area of each direction bin. least_attenuation: attenuation coefficient in air of the most penetrating
    gamma line, per metre.
    """

    def __init__(self, nuclide: str, truth: CameraTruth) -> None:
        """Raises ConfigError for an unknown nuclide."""
        lines = nuclide_of(nuclide).lines
        super().__init__(load_bank(nuclide, truth))
        self.nuclide = nuclide
        self.lines = len(lines)
        self._attenuation = [air_attenuation_per_m(energy) for energy, _ in lines]
        self.least_attenuation = min(self._attenuation)
        self._concrete = [concrete_attenuation_per_m(energy) for energy, _ in lines]

    def depths(self, distance_m: float, concrete_m: float) -> list[float]:
        """Return the optical depth of each gamma line through ``distance_m`` of air and ``concrete_m`` of concrete."""
        lines = zip(self._attenuation, self._concrete, strict=True)
        return [air * distance_m + concrete * concrete_m for air, concrete in lines]


def pick(emissions: Sequence[Pool], u: NDArray[np.float64], origins: Origins, first_tick: int, ticks: int) -> Picked:
    """Choose N events of several sets of stored events at random, in proportion to the rates of their origins.

    u: (N, 5) uniform random numbers, of which the first choose the origins. first_tick, ticks: begin and length of the exposure
    in clock ticks.
    """
    last = len(origins.bins) - 1
    origin = np.minimum(np.searchsorted(origins.cumulative, u[:, 0] * origins.cumulative[-1], side="right"), last)
    if len(emissions) == 1:
        return emissions[0].pick(u, origin, origins, first_tick, ticks)
    parts = []
    for k, emission in enumerate(emissions):
        mine = np.flatnonzero(origins.nuclide[origin] == k)
        parts.append(emission.pick(u[mine], origin[mine], origins, first_tick, ticks))
    return _joined(parts)


def _joined(parts: Sequence[Picked]) -> Picked:
    """The picked events of several banks as of one bank that holds them alone."""
    pixels, lengths = [], []
    for part in parts:
        begin = part.first[part.event]
        length = part.first[part.event + 1] - begin
        offset = np.cumsum(length) - length
        pixels.append(part.pixels[np.repeat(begin - offset, length) + np.arange(length.sum())])
        lengths.append(length)
    first = np.concatenate(([0], np.cumsum(np.concatenate(lengths))))
    event = np.arange(len(first) - 1)
    symmetry, tick = (np.concatenate(columns) for columns in ([p.symmetry for p in parts], [p.tick for p in parts]))
    return Picked(np.concatenate(pixels), first, event, symmetry, tick)


@jit
def _pick(
    u: NDArray[np.float64],
    origin: IntArray,
    bins: IntArray,
    symmetries: IntArray,
    excess: NDArray[np.float64],
    kind_cumulative: NDArray[np.float64],
    start: IntArray,
    count: IntArray,
    line: NDArray[np.uint8],
    first_tick: int,
    ticks: int,
) -> tuple[IntArray, IntArray, IntArray]:
    """Draw events: (N,) bank indices, symmetries and ticks from (N, 5) uniform numbers and (N,) origins.

    The rates include the transmission of the most penetrating line; events of other lines are thinned out to theirs.
    """
    event = np.empty(len(u), np.int64)
    symmetry = np.empty(len(u), np.int64)
    tick = np.empty(len(u), np.int64)
    size = 0
    for n in range(len(u)):
        place = bins[origin[n]]
        kind = 0
        while kind < KINDS - 1 and u[n, 1] >= kind_cumulative[place, kind]:
            kind += 1
        if count[place, kind] == 0:
            continue
        chosen = start[place, kind] + int(u[n, 2] * count[place, kind])
        keep = np.exp(-excess[origin[n], line[chosen]]) if origin[n] < len(excess) else 1.0
        symmetry[size] = symmetries[origin[n]] if symmetries[origin[n]] != FROM_ALL_DIRECTIONS else int(8.0 * u[n, 4])
        if keep < 1.0 and u[n, 4] >= keep:
            continue
        event[size] = chosen
        tick[size] = first_tick + int(u[n, 3] * ticks)
        size += 1
    return event[:size], symmetry[:size], tick[:size]
