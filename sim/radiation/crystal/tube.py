"""Counting tubes: a photon is counted when it frees an electron in the wall that reaches the gas.

Electrons fly straight, to a share of their range (Katz and Penfold 1952) that stands for their deflections; what the gas absorbs
itself, the ends of the tube, and a photon's second interaction are left out. Good to about 30 %.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from radron.sim.radiation._jit import jit
from radron.sim.radiation.crystal.body import beam, crossing
from radron.sim.radiation.crystal.matter import PAIR_THRESHOLD_KEV, Matter, at
from radron.sim.radiation.electrons import rotated
from radron.sim.radiation.ground.photons import scatter_free

FloatArray = NDArray[np.float64]

STRAIGHT_SHARE = 0.5  # projected over practical range in iron
_MIN_RANGE_KEV = 10.0


@jit
def range_gcm2(kinetic_kev: float) -> float:
    """Return the practical range of an electron, g/cm2 (Katz and Penfold 1952, 10 keV to 2.5 MeV)."""
    mev = max(kinetic_kev, _MIN_RANGE_KEV) * 1e-3
    return float(0.412 * mev ** (1.265 - 0.0954 * math.log(mev)))


@jit
def _electron(energy: float, matter: Matter, rng: np.random.Generator, direction: FloatArray, out: FloatArray) -> float:
    """Kinetic energy (keV) of the electron freed by a photon; ``out`` (3,) gets its direction."""
    process = rng.random() - at(energy, matter.photo)
    for axis in range(3):
        out[axis] = direction[axis]
    if process < 0.0:
        return energy
    if process >= at(energy, matter.compton) and energy > PAIR_THRESHOLD_KEV:
        return 0.5 * (energy - PAIR_THRESHOLD_KEV)
    scattered, cosine = scatter_free(energy, rng)
    kinetic = energy - scattered
    along = (energy - scattered * cosine) / math.sqrt(energy * energy + scattered * scattered - 2.0 * energy * scattered * cosine)
    u, v, w = rotated(direction[0], direction[1], direction[2], min(along, 1.0), 2.0 * math.pi * rng.random())
    out[0], out[1], out[2] = u, v, w
    return kinetic


@jit
def counting_area(
    energy_kev: float,
    cosine: float,
    outer: FloatArray,
    inner: FloatArray,
    density_gcm3: float,
    matter: Matter,
    radius: float,
    histories: int,
    rng: np.random.Generator,
) -> float:
    """Return the effective area (cm2) of a lying tube in a parallel flux of photons.

    Args:
        energy_kev: energy of the photons.
        cosine: of the angle between the way to the source and straight down; the azimuth is random.
        outer, inner: shapes of the tube and of its gas, the axis along z.
        density_gcm3: of the wall.
        matter: cross sections of the wall.
        radius: of a sphere about the tube, cm.
        histories: number of photons through that sphere.
        rng: random numbers.
    """
    position, direction, out = np.empty(3), np.empty(3), np.empty(3)
    per_cm = at(energy_kev, matter.per_cm)
    counted = 0.0
    for _ in range(histories):
        beam(cosine, radius, rng, position, direction)
        position[0], position[2] = position[2], -position[0]  # the tube lies: its axis z is horizontal
        direction[0], direction[2] = direction[2], -direction[0]
        enter, leave = crossing(position, direction, outer)
        if leave <= enter:
            continue
        gas_in, gas_out = crossing(position, direction, inner)
        wall = leave - enter - max(0.0, gas_out - gas_in)
        way = wall * rng.random()
        way += enter
        if gas_out > gas_in and way > gas_in:
            way += gas_out - gas_in
        weight = 1.0 - math.exp(-per_cm * wall)
        for axis in range(3):
            position[axis] += way * direction[axis]
        kinetic = _electron(energy_kev, matter, rng, direction, out)
        to_gas, from_gas = crossing(position, out, inner)
        if from_gas > to_gas and from_gas > 0.0 and to_gas * density_gcm3 < STRAIGHT_SHARE * range_gcm2(kinetic):
            counted += weight
    return counted * math.pi * radius * radius / histories
