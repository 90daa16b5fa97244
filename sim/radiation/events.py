"""Full simulation of events: photons of a beam through transport and response, kept as pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.radiation._jit import jit
from sim.radiation.electrons import Electrons, electrons
from sim.radiation.materials import CdTe, cdte
from sim.radiation.timepix3 import MAX_PIXELS, PIXEL, Response, Scratch, respond, scratch
from sim.radiation.transport import HALF_SIZE_MM, MAX_SITES, SITE_COLUMNS, attenuation_per_mm, enter, transport, way_out

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Kinds of events. What may be seen as two clusters is kept apart, and of that again what left all of the photon's energy, so that
# a bank can hold many of these rare, telling events.
SINGLE, SCATTERED, COMPLETE = range(3)
KINDS = 3
_APART_MM = 0.11  # two pixels
_CLUSTER_KEV = 32.0  # more than any K line: a fluorescence photon's neighbour makes no coincidence


@dataclass(frozen=True, slots=True)
class Events:
    """Events of one beam, interactions of photons that left energy in the sensor.

    pixels: (P,) of PIXEL. first: (E + 1,) event e has pixels[first[e]:first[e + 1]], perhaps none. line: (E,) which gamma line.
    kind: (E,) SINGLE, SCATTERED or COMPLETE. source: (E, 3) unit vector to the source. sites: (E, 2, 5) of the first two
    deposits x, y, z in mm, energy and electron energy in keV (zeros where there is one). area_mm2: (KINDS,) effective area
    times photons per decay for events of the kind, whether kept or not.
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
            if distance > _APART_MM and min(sites[k, 3], sites[m, 3]) > _CLUSTER_KEV:
                apart = True
    if not apart:
        return 0
    return 2 if total > energy_kev - 1.0 else 1


@jit
def _draw_direction(window: FloatArray, half: FloatArray, rng: np.random.Generator, source: FloatArray) -> float:
    """A random direction of the window (two cosines, two azimuths), written to source (3,); returns the sensor's shadow, mm2."""
    cosine = window[0] + (window[1] - window[0]) * rng.random()
    azimuth = window[2] + (window[3] - window[2]) * rng.random()
    sine = np.sqrt(max(0.0, 1.0 - cosine * cosine))
    source[0], source[1], source[2] = sine * np.cos(azimuth), sine * np.sin(azimuth), cosine
    x, y, z = half[0] * abs(source[0]), half[1] * abs(source[1]), half[2] * abs(source[2])
    volume = half[0] * half[1] * half[2]
    return float(4.0 * volume * (x / half[0] ** 2 + y / half[1] ** 2 + z / half[2] ** 2))


@jit
def _simulate(
    lines: FloatArray,
    window: FloatArray,
    wide: bool,
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
    # Most photons pass: only those are looked at that would interact on the longest way through the sensor.
    longest = 2.0 * np.sqrt((half * half).sum())
    if window[0] * window[1] > 0.0:
        longest = min(longest, 2.0 * half[2] / min(abs(window[0]), abs(window[1])))
    attenuation = np.empty(len(lines))
    for i in range(len(lines)):
        attenuation[i] = attenuation_per_mm(lines[i, 0], cdte)
    candidates = np.cumsum(lines[:, 1] * (1.0 - np.exp(-attenuation * longest)))
    largest = 4.0 * np.sqrt((half[1] * half[2]) ** 2 + (half[0] * half[2]) ** 2 + (half[0] * half[1]) ** 2)
    while done < interactions:
        shadow = _draw_direction(window, half, rng, source)
        trials += 1
        shadows += shadow
        # The beam meets the sensor in proportion to its shadow; within a small window of directions it is nearly the same.
        if wide and rng.random() * largest > shadow:
            continue
        line = min(np.searchsorted(candidates, rng.random() * candidates[-1]), len(lines) - 1)
        enter(source, half, rng, position)
        direction[:] = -source
        flight = -np.log(1.0 - rng.random() * (1.0 - np.exp(-attenuation[line] * longest))) / attenuation[line]
        if flight >= way_out(position, direction, half):
            continue
        count = transport(lines[line, 0], flight, position, direction, half, cdte, rng, sites, stack)
        if count == 0:
            continue
        done += 1
        kind = _kind(sites, count, lines[line, 0])
        found[kind] += 1.0
        if have[kind] >= quota[kind] or end + MAX_PIXELS > len(pixels):
            continue
        have[kind] += 1
        end = respond(sites, count, half, camera, electrons, rng, work, pixels, end)
        line_of[kept] = line
        kind_of[kept] = kind
        source_of[kept] = source
        sites_of[kept, : min(count, 2)] = sites[: min(count, 2), :5]
        kept += 1
        first[kept] = end
    scale = largest if wide else shadows / max(trials, 1)
    for kind in range(KINDS):
        area[kind] = found[kind] / max(trials, 1) * scale * candidates[-1]
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
    """Simulate as many interacting photons and keep the first of each kind up to its quota (all of them without one).

    lines: (energy in keV, photons per decay). The beam comes from ``direction`` (unit vector to the source, camera frame)
    or, without one, evenly from all directions with that range of polar cosine and azimuth.
    """
    if direction is not None:
        polar, turn = direction[2], float(np.arctan2(direction[1], direction[0]))
        cosine, azimuth = (polar, polar), (turn, turn)
    wide = cosine[1] - cosine[0] > 0.2 or azimuth[1] - azimuth[0] > 0.2
    limits = (interactions,) * KINDS if quota is None else quota
    size = min(interactions, sum(limits))
    pixels = np.zeros(size * 30 + 2 * MAX_PIXELS, PIXEL)
    first = np.zeros(size + 1, np.int64)
    line, kind = np.zeros(size, np.uint8), np.zeros(size, np.uint8)
    source, sites, area = np.zeros((size, 3)), np.zeros((size, 2, 5)), np.zeros(KINDS)
    kept = _simulate(
        np.array(lines, float).reshape(-1, 2),
        np.array([*cosine, *azimuth]),
        wide,
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
    return Events(pixels[: first[kept]], first[: kept + 1], line[:kept], kind[:kept], source[:kept], sites[:kept], area)
