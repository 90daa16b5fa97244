"""True ambient dose equivalent rate above contaminated ground, from the transport of photons over it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, contains_xy

from radron.sim.radiation.ground.area import AreaSource
from radron.sim.radiation.ground.areafield import PLACES, area_field
from radron.sim.radiation.ground.bank import group_energies_kev
from radron.sim.radiation.ground.photons import GROUPS
from radron.sim.radiation.materials import air_attenuation_per_m
from radron.sim.radiation.nuclides import nuclide

FloatArray = NDArray[np.float64]

STEP_M = 2.0  # between the places at which the highest dose rate is sought
# H*(10) per fluence, pSv cm2: ICRP publication 74 (1996), Table A.21.
_KEV = (
    20.0,
    30.0,
    40.0,
    50.0,
    60.0,
    80.0,
    100.0,
    150.0,
    200.0,
    300.0,
    400.0,
    500.0,
    600.0,
    800.0,
    1000.0,
    1500.0,
    2000.0,
    3000.0,
)
_PSV_CM2 = (1.05, 0.81, 0.64, 0.55, 0.51, 0.53, 0.61, 0.89, 1.20, 1.80, 2.38, 2.93, 3.44, 4.38, 5.20, 6.90, 8.60, 11.1)


def ambient_per_fluence(energy_kev: FloatArray) -> FloatArray:
    """Return H*(10) per photon fluence at these energies, Sv m2."""
    return np.asarray(1e-16 * np.exp(np.interp(np.log(energy_kev), np.log(_KEV), np.log(_PSV_CM2))))


def dose_at(areas: Sequence[AreaSource], ground_name: str, x_m: float, y_m: float, height_m: float = 1.0) -> float:
    """Return H*(10) at a place above contaminated ground, Sv/h, without the natural one. The activity is on the surface."""
    svps = 0.0
    for area in areas:
        radius = np.hypot(area.x_m - x_m, area.y_m - y_m)
        square = radius**2 + height_m**2
        weight = area.activity_bq / (4.0 * math.pi * square)
        scattered = area_field(area.nuclide, ground_name, 0.0).at(height_m)[:, :, :GROUPS].sum(axis=1)
        by_ring = scattered @ ambient_per_fluence(group_energies_kev())
        svps += float(weight @ np.interp(np.arcsinh(radius / height_m), PLACES, by_ring))
        for energy, intensity in nuclide(area.nuclide).lines:
            per_fluence = intensity * float(ambient_per_fluence(np.array([energy]))[0])
            svps += per_fluence * float(weight @ np.exp(-air_attenuation_per_m(energy) * np.sqrt(square)))
    return 3600.0 * svps


def ambient_dose_svph(areas: Sequence[AreaSource], ground_name: str, within: Polygon) -> float:
    """Return the highest H*(10) at 1 m above contaminated ground in an area, Sv/h, at places ``STEP_M`` apart."""
    west, south, east, north = within.bounds
    x, y = np.meshgrid(np.arange(west + 0.5 * STEP_M, east, STEP_M), np.arange(south + 0.5 * STEP_M, north, STEP_M))
    kept = contains_xy(within, x, y)
    return max(
        (dose_at(areas, ground_name, *place) for place in zip(x[kept].tolist(), y[kept].tolist(), strict=True)), default=0.0
    )
