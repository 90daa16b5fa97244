"""Monte Carlo transport of photons through a half-space of ground with air above it.

Each history is followed analogously, by Compton scattering off free electrons (Klein and Nishina) and photoelectric absorption,
until the photon is absorbed, below 30 keV, or far away. Flux: each crossing of a level counts 1 / |cosine of its angle to the
vertical|.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from radron.sim.radiation._jit import jit
from radron.sim.radiation.ground.materials import GRID, MAX_GRID_KEV, MIN_GRID_KEV, Medium
from radron.sim.radiation.materials import ELECTRON_MASS_KEV

FloatArray = NDArray[np.float64]

MIN_KEV = 30.0
GROUPS = 36  # of energy, evenly spaced in the logarithm from MIN_KEV to MAX_GROUP_KEV; photons above count in the last one
MAX_GROUP_KEV = 1500.0
COLUMNS = GROUPS + 1  # the last one: air kerma
TOWARDS, AROUND = range(2)  # of a point source: from within TOWARDS_DEG of the direction to it, or from elsewhere
BELOW, ABOVE = range(2)  # of the ground's own radioactivity
TOWARDS_DEG = 25.0
_CONE_COSINE = math.cos(math.radians(TOWARDS_DEG))
_CEILING_M = 300.0
_MIN_COSINE = 0.01  # crossings below it count as of half of it, the mean of an isotropic flux there


class Setting(NamedTuple):
    """Geometry and materials through which photons are simulated.

    energy_kev, cumulative: (L,) gamma lines, and their cumulative shares. source_m: height of a point source above the ground.
    depth_m: above 0: no point source, but sources evenly in the ground down to that depth. levels_m: (H,) heights of the levels
    at which the flux is counted, rising. rings: (R + 1,) edges of the rings on each level, as horizontal distance over height.
    kerma: (GRID,) air kerma per fluence.
    """

    energy_kev: FloatArray
    cumulative: FloatArray
    source_m: float
    depth_m: float
    levels_m: FloatArray
    rings: FloatArray
    air: Medium
    ground: Medium
    kerma: FloatArray


@jit
def scatter_free(energy_kev: float, rng: np.random.Generator) -> tuple[float, float]:
    """Draw energy (keV) and cosine of the angle after scattering off a free electron: by rejection from a mixture, after Kahn."""
    k = energy_kev / ELECTRON_MASS_KEV
    least = 1.0 / (1.0 + 2.0 * k)
    share = math.log(1.0 / least) / (math.log(1.0 / least) + 0.5 * (1.0 - least * least))
    while True:
        u = rng.random()
        ratio = least**u if rng.random() < share else math.sqrt(least * least + (1.0 - least * least) * u)
        versine = (1.0 - ratio) / (k * ratio)
        if rng.random() < 1.0 - ratio * versine * (2.0 - versine) / (1.0 + ratio * ratio):
            return energy_kev * ratio, 1.0 - versine


@jit
def _turn(photon: FloatArray, cosine: float, azimuth: float) -> None:
    """Turn a photon's direction, photon[3:6], by an angle."""
    u, v, w = photon[3], photon[4], photon[5]
    sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
    flat = math.sqrt(max(0.0, 1.0 - w * w))
    a, b = sine * math.cos(azimuth), sine * math.sin(azimuth)
    if flat < 1e-9:
        u, v, w = a, b, cosine * w
    else:
        u, v, w = cosine * u + (a * u * w - b * v) / flat, cosine * v + (a * v * w + b * u) / flat, cosine * w - a * flat
    norm = math.sqrt(u * u + v * v + w * w)
    photon[3], photon[4], photon[5] = u / norm, v / norm, w / norm


@jit
def _count(setting: Setting, tally: FloatArray, photon: FloatArray, end: float, group: int, kerma: float) -> None:
    """Count the levels that a photon crosses in the air on its way to the height ``end``."""
    x, y, z, u, v, w = photon[0], photon[1], photon[2], photon[3], photon[4], photon[5]
    rings = setting.rings
    low, high = min(z, end), max(z, end)
    for level in range(len(setting.levels_m)):
        height = setting.levels_m[level]
        if height <= low or height > high:
            continue
        way = (height - z) / w
        px, py = x + way * u, y + way * v
        ring = np.searchsorted(rings, math.hypot(px, py) / height, side="right") - 1
        if ring >= len(rings) - 1:
            continue
        weight = 1.0 / (abs(w) if abs(w) > _MIN_COSINE else 0.5 * _MIN_COSINE)
        side = BELOW if w > 0.0 else ABOVE
        if setting.depth_m == 0.0:
            off = height - setting.source_m
            square = px * px + py * py + off * off
            weight *= 4.0 * square / (height * height * (rings[ring + 1] ** 2 - rings[ring] ** 2))
            side = TOWARDS if u * px + v * py + w * off > _CONE_COSINE * math.sqrt(square) else AROUND
        tally[level, ring, side, group] += weight
        tally[level, ring, side, GROUPS] += weight * kerma


@jit
def _start(setting: Setting, photon: FloatArray, rng: np.random.Generator) -> float:
    """A new photon: its place photon[:3] and direction photon[3:6]; returns its energy."""
    w, azimuth = 2.0 * rng.random() - 1.0, 2.0 * math.pi * rng.random()
    flat = math.sqrt(1.0 - w * w)
    photon[0], photon[1] = 0.0, 0.0
    photon[2] = setting.source_m if setting.depth_m == 0.0 else -setting.depth_m * rng.random()
    photon[3], photon[4], photon[5] = flat * math.cos(azimuth), flat * math.sin(azimuth), w
    line = int(np.searchsorted(setting.cumulative, rng.random(), side="right"))
    return float(setting.energy_kev[min(line, len(setting.energy_kev) - 1)])


@jit
def _fly(
    setting: Setting, tally: FloatArray, photon: FloatArray, energy: float, is_counted: bool, rng: np.random.Generator
) -> float:
    """Move a photon to its next interaction. Returns the share of Compton scattering there; -1: it is too far away."""
    place = math.log(energy / MIN_GRID_KEV) * ((GRID - 1) / math.log(MAX_GRID_KEV / MIN_GRID_KEV))
    cell = min(int(place), GRID - 2)
    part = place - cell
    kerma = setting.kerma[cell] * (1.0 - part) + setting.kerma[cell + 1] * part
    group = max(0, min(int(math.log(energy / MIN_KEV) * (GROUPS / math.log(MAX_GROUP_KEV / MIN_KEV))), GROUPS - 1))
    in_ground = photon[2] < 0.0 or (photon[2] == 0.0 and photon[5] < 0.0)
    depth = -math.log(1.0 - rng.random())
    while True:  # from medium to medium
        medium = setting.ground if in_ground else setting.air
        attenuation = medium.attenuation[cell] * (1.0 - part) + medium.attenuation[cell + 1] * part
        way = depth / attenuation
        end = photon[2] + photon[5] * way
        leaves = end > 0.0 if in_ground else end < 0.0
        if leaves:
            way, end = -photon[2] / photon[5], 0.0
        if is_counted and not in_ground:
            _count(setting, tally, photon, end, group, kerma)
        photon[0] += way * photon[3]
        photon[1] += way * photon[4]
        photon[2] = end
        if not leaves:
            break
        depth -= way * attenuation
        in_ground = not in_ground
    if abs(photon[2]) > _CEILING_M:
        return -1.0
    return float(medium.compton[cell] * (1.0 - part) + medium.compton[cell + 1] * part)


@jit
def follow(setting: Setting, histories: int, rng: np.random.Generator) -> FloatArray:
    """Simulate a number of photons (``histories``) through ground and air, and return their flux.

    The result is (H, R, 2, COLUMNS): flux by level, ring, side and energy group, per emitted photon. For a point source it is the
    flux of scattered photons times 4 pi D^2, D the distance from the source, as a mean over each ring. For radioactivity of the
    ground it is the flux of all photons over an infinite plane that emits one photon per area.
    """
    tally = np.zeros((len(setting.levels_m), len(setting.rings) - 1, 2, COLUMNS))
    photon = np.empty(6)
    for _ in range(histories):
        energy = _start(setting, photon, rng)
        is_counted = setting.depth_m > 0.0
        while energy > MIN_KEV and rng.random() < _fly(setting, tally, photon, energy, is_counted, rng):
            energy, cosine = scatter_free(energy, rng)
            _turn(photon, cosine, 2.0 * math.pi * rng.random())
            is_counted = True
    return tally / histories
