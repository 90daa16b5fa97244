"""Photon fluxes over ground, converted to figures of a camera: hits by scattered photons, natural background, air kerma."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from radron.sim.radiation.bank import SCATTERED_BIN, bin_centres
from radron.sim.radiation.ground.bank import DIRECTIONS, ground_bank
from radron.sim.radiation.ground.field import LEVELS_M, natural_flux, natural_series, point_field
from radron.sim.radiation.ground.photons import GROUPS
from radron.sim.radiation.materials import air_attenuation_per_m
from radron.sim.radiation.nuclides import nuclide
from radron.sim.radiation.store import load_bank
from radron.sim.radiation.timepix3 import response
from radron.sim.radiation.truth import CameraTruth

FloatArray = NDArray[np.float64]


@cache
def isotropic_mm2() -> FloatArray:
    """Return the camera's effective area for photons that come evenly from all directions, (GROUPS,) by energy group, mm2."""
    area = ground_bank(response(CameraTruth())).area_mm2.sum(axis=1).reshape(DIRECTIONS + 1, GROUPS)
    return np.asarray(area[DIRECTIONS])


@cache
def direct_mm2(name: str) -> float:
    """Return the effective area times photons per decay (mm2) for direct photons of a nuclide, as a mean over all directions."""
    area = load_bank(name, CameraTruth()).area_mm2.sum(axis=1)
    centres = bin_centres()
    sine = np.hypot(centres[:, 0], centres[:, 1])
    rows = np.unique(centres[:, 2], return_counts=True, return_inverse=True)
    weight = sine / rows[2][rows[1].ravel()]
    return float(weight @ area[:SCATTERED_BIN] / weight.sum())


def scattered_share(name: str, ground: str, place_m: float, height_m: float, horizontal_m: float) -> float:
    """Return the ratio of hits by scattered photons to hits by direct photons, for a source on, in or above the ground.

    The view is clear, and the ratio is a mean over all directions of the camera. place_m: height of the source above the ground;
    below 0: depth in the ground (attenuation by this soil is then left out). height_m: height of the camera. horizontal_m: its
    distance.
    """
    distance_m = math.hypot(height_m - max(place_m, 0.0), horizontal_m)
    scattered = point_field(name, ground, place_m).times_square(height_m, horizontal_m)[:, :GROUPS].sum(axis=0)
    least = min(air_attenuation_per_m(energy) for energy, _ in nuclide(name).lines)
    return float(scattered @ isotropic_mm2()) / (direct_mm2(name) * math.exp(-least * distance_m))


def hits_per_s(ground: str, height_m: float) -> float:
    """Return the camera's rate of hits (1/s) by photons of the ground's own radioactivity, at a height above the ground."""
    return float(natural_flux(ground, height_m) @ isotropic_mm2()) * 1e-6


def kerma_per_activity(ground: str) -> FloatArray:
    """Return the air kerma rate 1 m above ground per activity of the ground, in Gy/s per Bq/kg.

    The result is (3,): K-40, U-238 series and Th-232 series.
    """
    level = int(np.flatnonzero(LEVELS_M == 1.0)[0])
    return np.asarray(natural_series(ground)[:, level, :, GROUPS].sum(axis=1))
