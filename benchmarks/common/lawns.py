"""Synthetic surveys of contaminated ground: exposures by the truth's tables of photons, not by the agent's kernels.

A camera turns while it flies, so that its counts are a mean over all headings. They come from the simulation's fluxes of
scattered photons over soil, and its areas of the sensor by direction.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from radron.sim.radiation.bank import near_bin
from radron.sim.radiation.emission import Emission
from radron.sim.radiation.ground.bank import DIRECTIONS, ISOTROPIC, direction_of, ground_bank
from radron.sim.radiation.ground.field import natural_flux, point_field
from radron.sim.radiation.ground.photons import AROUND, GROUPS, TOWARDS
from radron.sim.radiation.store import load_bank
from radron.sim.radiation.timepix3 import response
from radron.sim.radiation.truth import CameraTruth

Array = NDArray[np.float64]

TRUTH = CameraTruth()
FULL_SHARE = 0.186, 0.36  # of Cs-137's direct photons, and its growth with the depth of air: benchmarks/channel_response.py
RADII_M = np.concatenate(([0.0], np.geomspace(0.3, 320.0, 60)))
FINE_M = 0.5
SPAN_M = 160.0  # ground beyond the area that counts


@cache
def point_table(nuclide: str, height_m: float, soil: str = "soil") -> Array:
    """Return (3, R): the area (mm2) times photons per decay at ``RADII_M``, of direct photons counted in part and in full, and of
    scattered ones. The flux is per 4 pi D^2.
    """
    emission, bank = Emission(nuclide, TRUTH), load_bank(nuclide, TRUTH)
    ground = ground_bank(response(TRUTH)).area_mm2.sum(axis=1).reshape(DIRECTIONS + 1, GROUPS)
    field = point_field(nuclide, soil, -0.002)
    rng, result = np.random.default_rng(5), np.zeros((3, len(RADII_M)))
    for place, radius in enumerate(RADII_M.tolist()):
        distance = math.hypot(radius, height_m)
        flux = field.times_square(height_m, radius)[:, :GROUPS]
        air = math.exp(-emission.least_attenuation * distance)
        azimuths = np.linspace(0.0, 2.0 * math.pi, 48, endpoint=False) + 0.03
        for azimuth in azimuths.tolist():
            unit = (radius * math.sin(azimuth) / distance, height_m / distance, radius * math.cos(azimuth) / distance)
            areas = bank.area_mm2[near_bin(unit, rng.random(), rng.random())[0]]
            full = FULL_SHARE[0] * (1.0 + FULL_SHARE[1] * emission.least_attenuation * distance) * areas.sum() * air
            scattered = flux[TOWARDS] @ ground[direction_of(unit)[0]] + flux[AROUND] @ ground[ISOTROPIC]
            result[:, place] += areas.sum() * air - full, full, scattered
        result[:, place] /= len(azimuths)
    return result


def kernel(nuclide: str, height_m: float, radius: Array) -> Array:
    """Return (..., 2) counts per second of a becquerel, partial- and full-energy, at horizontal distances (...)."""
    table = point_table(nuclide, round(height_m, 3))
    spread = 1.0 / (4e6 * math.pi * (radius * radius + height_m * height_m))
    partial, full, scattered = (np.interp(np.log(radius + 0.1), np.log(RADII_M + 0.1), row) * spread for row in table)
    return np.stack((partial + scattered, full), axis=-1)


def background_ps(height_m: float) -> Array:
    """Return (2,) the camera's events per second over clean soil; a hundredth in the window of a line."""
    ground = ground_bank(response(TRUTH)).area_mm2.sum(axis=1).reshape(DIRECTIONS + 1, GROUPS)[ISOTROPIC]
    every = float(natural_flux("soil", height_m) @ ground) * 1e-6 + 0.2 * TRUTH.background_hits_per_s
    return np.array([0.99 * every, 0.01 * every])
