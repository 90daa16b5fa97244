"""Ambient dose equivalent rate H*(10) one metre above contaminated ground.

A becquerel on the ground gives at the distance d the rate

    k(d) = G / d^2 exp(-mu d) (1 + BUILD_UP mu d),    G = sum over lines of (photons per decay) h*(10) / 4 pi,

h*(10) of ICRP 74 (1996), Table A.21. With it an infinite plane of Cs-137 gives 3.08e-12 Sv/h per Bq/m2 at one metre, 0.69 of
that at 5 m and 0.56 at 10 m, as transport over a bare surface does (3.08e-12, 0.70, 0.58). The depth is unknown: activity as if
on the surface makes up for most of it.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy.signal import fftconvolve

from radron.agent.detector.lines import GAMMAS
from radron.agent.fusion.field.grid import Grid
from radron.agent.geometry import Array

HEIGHT_M: Final = 1.0
BUILD_UP: Final = 1.17
_ENERGY_KEV: Final = (50.0, 60.0, 80.0, 100.0, 150.0, 200.0, 300.0, 400.0, 500.0, 600.0, 800.0, 1000.0, 1500.0, 2000.0)
_PSV_CM2: Final = (0.53, 0.51, 0.53, 0.61, 0.89, 1.20, 1.80, 2.38, 2.93, 3.44, 4.38, 5.20, 6.90, 8.60)
_POINTS: Final = 8  # along a cell's side
_AIR_PER_M: Final = 0.0093  # at 662 keV


def constant(nuclide: str) -> float:
    """Return G, Sv m2 / h per Bq."""
    by_line = (share * float(np.interp(energy, _ENERGY_KEV, _PSV_CM2)) for energy, share in GAMMAS[nuclide])
    return sum(by_line) * 1e-12 * 1e-4 / (4.0 * math.pi) * 3600.0


def rate(nuclide: str, distance_m: Array, air_per_m: float = _AIR_PER_M) -> Array:
    """Return k, Sv/h per Bq, at distances of any shape."""
    depth = air_per_m * distance_m
    result: Array = constant(nuclide) * np.exp(-depth) * (1.0 + BUILD_UP * depth) / distance_m**2
    return result


def dose_map(nuclide: str, activity: Array, grid: Grid) -> Array:
    """Return the rates (N,) above the cells, Sv/h, of activities per area (N,), Bq/m2; means over each cell."""
    each = (np.arange(_POINTS) + 0.5) / _POINTS - 0.5
    x = (np.arange(-grid.columns + 1, grid.columns)[:, None] + each).ravel() * grid.cell_m
    y = (np.arange(-grid.rows + 1, grid.rows)[:, None] + each).ravel() * grid.cell_m
    fine = rate(nuclide, np.sqrt(x * x + y[:, None] ** 2 + HEIGHT_M**2))
    of_cells = fine.reshape(2 * grid.rows - 1, _POINTS, 2 * grid.columns - 1, _POINTS).mean(axis=(1, 3)) * grid.cell_m**2
    table = activity.reshape(grid.rows, grid.columns)
    whole = fftconvolve(table, of_cells, mode="full")
    return np.asarray(whole[grid.rows - 1 : 2 * grid.rows - 1, grid.columns - 1 : 2 * grid.columns - 1].ravel(), np.float64)
