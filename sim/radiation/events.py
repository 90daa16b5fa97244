"""Full simulation of events: photons of a beam are transported through the sensor, and the pixels that they hit are kept."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from radron.sim.radiation._jit import jit
from radron.sim.radiation.electrons import Electrons, electrons
from radron.sim.radiation.materials import CdTe, cdte
from radron.sim.radiation.timepix3 import MAX_PIXELS, PIXEL, Response, Scratch, respond, scratch
from radron.sim.radiation.transport import HALF_SIZE_MM, MAX_SITES, SITE_COLUMNS, attenuation_per_mm, enter, transport, way_out

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Kinds of events. What may be seen as two clusters is kept apart, and of that again what left all of the photon's energy, so that
# a bank can hold many of these rare, telling events.
SINGLE, SCATTERED, COMPLETE = range(3)
KINDS = 3
_APART_MM = 0.11  # two pixels
CLUSTER_KEV = 32.0  # more than any K line: a fluorescence photon's neighbour makes no coincidence
_ROOM = 60  # pixels per event, on average over a run: twice what 1.4 MeV needs


@dataclass(frozen=True, slots=True)
class Events:
    """Simulated events of one photon beam: interactions that left energy in the sensor. E events with P pixels.

    pixels: (P,) of PIXEL. first: (E + 1,) event e has pixels[first[e]:first[e + 1]], perhaps none. line: (E,) index of the gamma
    line. kind: (E,) SINGLE, SCATTERED or COMPLETE. source: (E, 3) unit vector to the source. sites: (E, 2, 5) of the first two
    deposits x, y, z in mm, energy and electron energy in keV (zeros where there is one). area_mm2: (KINDS,) effective area times
    photons per decay for events of the kind, whether kept or not.
    """

    pixels: NDArray[np.void]
    first: IntArray
    line: NDArray[np.uint8]
    kind: NDArray[np.uint8]
    source: FloatArray
    sites: FloatArray
    area_mm2: FloatArray


@jit
def _kind(sites: FloatArray, count: int, energy_kev: float) -> int:
    total = 0.0
    apart = False
    for k in range(count):
        total += sites[k, 3]
        for m in range(k):
            distance = np.hypot(sites[k, 0] - sites[m, 0], sites[k, 1] - sites[m, 1])
            if distance > _APART_MM and min(sites[k, 3], sites[m, 3]) > CLUSTER_KEV:
                apart = True
    if not apart:
        return 0
    return 2 if total > energy_kev - 1.0 else 1


class _Beam(NamedTuple):
    """Photons on their way. L lines.

    energy_kev, attenuation: (L,) of each line, per mm. candidates: (L,) cumulative photons per decay that would interact on
    ``longest`` mm. window: two cosines of the polar angle, two azimuths. largest: no smaller than the shadow in the window, mm2;
    zero where the window is so small that the shadow is nearly the same all over it.
    """

    energy_kev: FloatArray
    attenuation: FloatArray
    candidates: FloatArray
    longest: float
    window: FloatArray
    largest: float


def _beam(lines: Sequence[tuple[float, float]], cosine: tuple[float, float], azimuth: tuple[float, float]) -> _Beam:
    half = HALF_SIZE_MM
    longest = 2.0 * float(np.linalg.norm(half))
    if cosine[0] * cosine[1] > 0.0:
        longest = min(longest, 2.0 * float(half[2]) / min(abs(cosine[0]), abs(cosine[1])))
    energy, intensity = np.array(lines, float).reshape(-1, 2).T.copy()
    attenuation = np.array([attenuation_per_mm(e, cdte()) for e in energy])
    candidates = np.cumsum(intensity * -np.expm1(-attenuation * longest))
    small = cosine[1] - cosine[0] < 0.2 and azimuth[1] - azimuth[0] < 0.2
    largest = 4.0 * float(np.linalg.norm((half[1] * half[2], half[0] * half[2], half[0] * half[1])))
    return _Beam(energy, attenuation, candidates, longest, np.array([*cosine, *azimuth]), 0.0 if small else largest)


@jit
def _draw_direction(window: FloatArray, half: FloatArray, rng: np.random.Generator, source: FloatArray) -> float:
    """A random direction of the window, written to source (3,); returns the sensor's shadow in it, mm2."""
    cosine = window[0] + (window[1] - window[0]) * rng.random()
    azimuth = window[2] + (window[3] - window[2]) * rng.random()
    sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
    x, y = sine * math.cos(azimuth), sine * math.sin(azimuth)
    source[0], source[1], source[2] = x, y, cosine
    return float(4.0 * (half[1] * half[2] * abs(x) + half[0] * half[2] * abs(y) + half[0] * half[1] * abs(cosine)))


@jit
def _simulate(
    beam: _Beam,
    interactions: int,
    quota: IntArray,
    half: FloatArray,
    cdte: CdTe,
    electrons: Electrons,
    camera: Response,
    rng: np.random.Generator,
    work: Scratch,
    pixels: NDArray[np.void],
    first: IntArray,
    line_of: NDArray[np.uint8],
    kind_of: NDArray[np.uint8],
    source_of: FloatArray,
    sites_of: FloatArray,
    area: FloatArray,
) -> int:
    """See simulate, and Events for the arrays that this fills; returns the number of events kept."""
    sites = np.empty((MAX_SITES, SITE_COLUMNS))
    stack = np.empty((MAX_SITES + 1, 7))
    source = np.empty(3)
    position = np.empty(3)
    direction = np.empty(3)
    kept = 0
    end = 0
    done = 0
    trials = 0
    shadows = 0.0
    found = np.zeros(KINDS)
    have = np.zeros(KINDS, np.int64)
    while done < interactions:
        shadow = _draw_direction(beam.window, half, rng, source)
        trials += 1
        shadows += shadow
        # A beam meets the sensor in proportion to its shadow.
        if rng.random() * beam.largest > shadow:
            continue
        # Most photons pass: only those are looked at that would interact on the longest way through the sensor.
        line = min(np.searchsorted(beam.candidates, rng.random() * beam.candidates[-1]), len(beam.candidates) - 1)
        enter(source, half, rng, position)
        for axis in range(3):
            direction[axis] = -source[axis]
        reach = 1.0 - math.exp(-beam.attenuation[line] * beam.longest)
        flight = -math.log(1.0 - rng.random() * reach) / beam.attenuation[line]
        if flight >= way_out(position, direction, half):
            continue
        count = transport(beam.energy_kev[line], flight, position, direction, half, cdte, rng, sites, stack)
        if count == 0:
            continue
        done += 1
        kind = _kind(sites, count, beam.energy_kev[line])
        found[kind] += 1.0
        if have[kind] >= quota[kind] or end + MAX_PIXELS > len(pixels):
            continue
        have[kind] += 1
        end = respond(sites, count, half, camera, electrons, rng, work, pixels, end)
        line_of[kept] = line
        kind_of[kept] = kind
        for axis in range(3):
            source_of[kept, axis] = source[axis]
        for k in range(min(count, 2)):
            for column in range(5):
                sites_of[kept, k, column] = sites[k, column]
        kept += 1
        first[kept] = end
    scale = beam.largest if beam.largest > 0.0 else shadows / max(trials, 1)
    for kind in range(KINDS):
        area[kind] = found[kind] / max(trials, 1) * scale * beam.candidates[-1]
    return kept


def simulate(
    lines: Sequence[tuple[float, float]],
    interactions: int,
    camera: Response,
    rng: np.random.Generator,
    *,
    direction: tuple[float, float, float] | None = None,
    cosine: tuple[float, float] = (-1.0, 1.0),
    azimuth: tuple[float, float] = (0.0, 2.0 * np.pi),
    quota: tuple[int, int, int] | None = None,
    fluorescence: bool = True,
) -> Events:
    """Simulate the events of a number of interacting photons, and keep the first events of each kind up to its quota.

    Without a quota all events are kept. lines: (energy in keV, photons per decay). The beam comes from ``direction`` (unit vector
    to the source, camera frame) or, without one, evenly from all directions with that range of polar cosine and azimuth.
    """
    if direction is not None:
        polar, turn = direction[2], float(np.arctan2(direction[1], direction[0]))
        cosine, azimuth = (polar, polar), (turn, turn)
    limits = (interactions,) * KINDS if quota is None else quota
    size = min(interactions, sum(limits))
    pixels = np.zeros(size * _ROOM + 2 * MAX_PIXELS, PIXEL)
    first = np.zeros(size + 1, np.int64)
    line, kind = np.zeros(size, np.uint8), np.zeros(size, np.uint8)
    source, sites, area = np.zeros((size, 3)), np.zeros((size, 2, 5)), np.zeros(KINDS)
    kept = _simulate(
        _beam(lines, cosine, azimuth),
        interactions,
        np.array(limits),
        HALF_SIZE_MM,
        cdte() if fluorescence else cdte()._replace(k_yield=np.zeros(2)),
        electrons(),
        camera,
        rng,
        scratch(),
        pixels,
        first,
        line,
        kind,
        source,
        sites,
        area,
    )
    return Events(pixels[: first[kept]].copy(), first[: kept + 1], line[:kept], kind[:kept], source[:kept], sites[:kept], area)
