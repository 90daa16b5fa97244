"""Photons in a crystal: analog Monte Carlo with a forced first interaction, from the entry to absorption or escape.

Photoelectric absorption, Compton scattering off free electrons, pair production with two annihilation photons. Electrons stop
where they are freed; X rays of the crystal do not escape; nothing surrounds it.
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
from radron.sim.radiation.materials import ELECTRON_MASS_KEV

FloatArray = NDArray[np.float64]

MIN_TRACKED_KEV = 12.0  # absorbed where it is below this energy
_FULL_KEV = 0.5  # escaped energy up to which a deposit counts as the photon's whole
_STACK = 4


@jit
def _deposit(
    energy: float,
    position: FloatArray,
    direction: FloatArray,
    shape: FloatArray,
    matter: Matter,
    rng: np.random.Generator,
    stack: FloatArray,
) -> float:
    """Energy (keV) that a photon deposits which interacts first at ``position``; both arrays are overwritten."""
    deposit, waiting, is_there = 0.0, 0, True
    while True:
        while energy > MIN_TRACKED_KEV:
            if not is_there:
                way = -math.log(1.0 - rng.random()) / at(energy, matter.per_cm)
                if way >= crossing(position, direction, shape)[1]:
                    energy = 0.0
                    break
                for axis in range(3):
                    position[axis] += way * direction[axis]
            is_there = False
            process = rng.random() - at(energy, matter.photo)
            if process < 0.0:
                break
            if process < at(energy, matter.compton) or energy <= PAIR_THRESHOLD_KEV:
                scattered, cosine = scatter_free(energy, rng)
                u, v, w = rotated(direction[0], direction[1], direction[2], cosine, 2.0 * math.pi * rng.random())
                direction[0], direction[1], direction[2] = u, v, w
                deposit += energy - scattered
                energy = scattered
                continue
            deposit += energy - PAIR_THRESHOLD_KEV
            energy = ELECTRON_MASS_KEV
            w, azimuth = 2.0 * rng.random() - 1.0, 2.0 * math.pi * rng.random()
            flat = math.sqrt(1.0 - w * w)
            direction[0], direction[1], direction[2] = flat * math.cos(azimuth), flat * math.sin(azimuth), w
            if waiting < _STACK:
                for axis in range(3):
                    stack[waiting, axis], stack[waiting, 3 + axis] = position[axis], -direction[axis]
                waiting += 1
        deposit += energy
        if waiting == 0:
            return deposit
        waiting -= 1
        energy, is_there = ELECTRON_MASS_KEV, False
        for axis in range(3):
            position[axis], direction[axis] = stack[waiting, axis], stack[waiting, 3 + axis]


@jit
def areas(
    energy_kev: float,
    cosine: float,
    shape: FloatArray,
    matter: Matter,
    radius: float,
    histories: int,
    step_kev: float,
    bins: int,
    rng: np.random.Generator,
) -> tuple[float, FloatArray]:
    """Return the effective areas (cm2) of a crystal in a parallel flux: of the full energy, and of all else by deposited energy.

    Args:
        energy_kev: energy of the photons.
        cosine: of the angle between the way to the source and straight down; the azimuth is random.
        shape: see ``radron.sim.radiation.crystal.body``.
        matter: cross sections.
        radius: of a sphere about the crystal, cm.
        histories: number of photons through that sphere.
        step_kev, bins: width and number of the bins of deposited energy; the first begins at 0.
        rng: random numbers.
    """
    position, direction, stack = np.empty(3), np.empty(3), np.empty((_STACK, 6))
    rest = np.zeros(bins)
    full = 0.0
    per_cm = at(energy_kev, matter.per_cm)
    for _ in range(histories):
        beam(cosine, radius, rng, position, direction)
        enter, leave = crossing(position, direction, shape)
        if leave <= enter:
            continue
        weight = 1.0 - math.exp(-per_cm * (leave - enter))
        way = enter - math.log(1.0 - weight * rng.random()) / per_cm
        for axis in range(3):
            position[axis] += way * direction[axis]
        deposit = _deposit(energy_kev, position, direction, shape, matter, rng, stack)
        if deposit > energy_kev - _FULL_KEV:
            full += weight
        else:
            rest[min(int(deposit / step_kev), bins - 1)] += weight
    scale = math.pi * radius * radius / histories
    return full * scale, rest * scale
