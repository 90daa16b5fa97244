"""Flux of photons at a camera over ground: photons of a source that ground and air scatter, and photons of the ground's activity.

Tables of ``photons.follow`` by height and horizontal distance, made when they are first needed (seconds), with a fixed seed, and
kept in the user's cache. Checked against published values in tests/sim/ground.
"""

from __future__ import annotations

import hashlib
import math
from bisect import bisect_left
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radron.sim.radiation.ground.materials import GROUNDS, air, ground, kerma_per_fluence
from radron.sim.radiation.ground.natural import RADON_DAUGHTERS, SERIES, Lines
from radron.sim.radiation.ground.photons import GROUPS, Setting, follow
from radron.sim.radiation.nuclides import nuclide
from radron.sim.radiation.store import kept

FloatArray = NDArray[np.float64]

LEVELS_M: FloatArray = np.array((0.5, 1.0, 2.0, 3.5, 6.0, 10.0, 17.0, 30.0))
RINGS: FloatArray = np.array((0.0, 0.5, 1.0, 1.5, 2.2, 3.3, 5.0, 8.0, 13.0, 21.0))
SOURCE_HEIGHTS_M = (0.0, 0.3, 1.0, 3.0, 10.0)  # the nearest one's table serves
_RAIN_DEPTH_M = 0.001  # of radon's daughters: dust lies between grains and blades
NATURAL_DEPTH_M = 1.0  # deeper, 10 mean free paths of 2.6 MeV, nothing comes from
_HISTORIES = 1_000_000
_NATURAL_HISTORIES = 500_000
_MADE_BY = ("field", "materials", "natural", "photons")

_PLACES = np.arcsinh(np.sqrt(0.5 * (RINGS[1:] ** 2 + RINGS[:-1] ** 2))).tolist()  # of the rings, where their mean is right
_LEVELS = np.log(LEVELS_M).tolist()
_MIN_M = float(LEVELS_M[0])
_ONE_METRE = int(np.flatnonzero(LEVELS_M == 1.0)[0])


class PointField:
    """Flux of the scattered photons of one nuclide near a point source at rest on, in or above one kind of ground."""

    def __init__(self, table: FloatArray) -> None:
        """table: (H, R, 2, COLUMNS) of ``LEVELS_M`` and ``RINGS``, per decay, as of ``photons.follow``."""
        self._table = table

    def times_square(self, height_m: float, horizontal_m: float) -> FloatArray:
        """Return the flux of scattered photons at a camera, times 4 pi D^2, and the air kerma; D: distance from the source.

        The result is (2, COLUMNS): photons from the source's side and from elsewhere; by energy group, per decay, and air kerma
        (Gy m2). height_m: height of the camera; horizontal_m: its horizontal distance. Beyond the table the values at its edge
        are used.
        """
        height_m = max(height_m, _MIN_M)
        level, above = _between(math.log(height_m), _LEVELS)
        ring, beyond = _between(math.asinh(horizontal_m / height_m), _PLACES)
        rows = (1.0 - above) * self._table[level, ring : ring + 2] + above * self._table[level + 1, ring : ring + 2]
        return np.asarray((1.0 - beyond) * rows[0] + beyond * rows[1])


def _between(value: float, places: list[float]) -> tuple[int, float]:
    """The cell of the rising places in which the value lies, and its share of the way to the next one."""
    cell = min(max(bisect_left(places, value) - 1, 0), len(places) - 2)
    return cell, min(max((value - places[cell]) / (places[cell + 1] - places[cell]), 0.0), 1.0)


def point_field(nuclide_name: str, ground_name: str, place_m: float) -> PointField:
    """Return the flux of scattered photons of a point source of a nuclide.

    place_m: height of the source above the ground, of which the nearest tabulated one is used; below zero: depth in the ground.
    """
    if place_m > 0.0:
        place_m = min(SOURCE_HEIGHTS_M, key=lambda known: abs(known - place_m))
    return _point_field(nuclide_name, ground_name, place_m)


@cache
def _point_field(nuclide_name: str, ground_name: str, place_m: float) -> PointField:
    lines = nuclide(nuclide_name).lines
    per_decay = sum(intensity for _, intensity in lines)

    def make() -> FloatArray:
        return per_decay * follow(_setting(lines, ground_name, place_m, 0.0, RINGS), _HISTORIES, np.random.default_rng(1))

    return PointField(_cached(f"{nuclide_name}-{ground_name}-{place_m:g}", make))


@cache
def natural_series(ground_name: str) -> FloatArray:
    """Return the photon fluxes over ground with an activity of 1 Bq/kg of K-40, of the U-238 or of the Th-232 series.

    The result is (series, H, 2, COLUMNS): flux per m2 and s at the heights ``LEVELS_M``, from below and from above, by energy
    group; the last column is the air kerma rate (Gy/s).
    """
    per_area = 1e3 * GROUNDS[ground_name].density_gcm3 * NATURAL_DEPTH_M

    def make() -> FloatArray:
        return np.array([per_area * _plane(lines, ground_name, NATURAL_DEPTH_M) for lines in SERIES])

    return _cached(f"natural-{ground_name}", make)


@cache
def rain_field(ground_name: str) -> FloatArray:
    """Return the photon fluxes of 1 Bq/m2 of radon's daughters on the ground.

    The result is (H, 2, COLUMNS), as for one series of :func:`natural_series`.
    """
    return _cached(f"rain-{ground_name}", lambda: _plane(RADON_DAUGHTERS, ground_name, _RAIN_DEPTH_M))


def _plane(lines: Lines, ground_name: str, depth_m: float) -> FloatArray:
    """(H, 2, COLUMNS): of one decay per area, evenly down to a depth."""
    setting = _setting(lines, ground_name, 0.0, depth_m, np.array((0.0, 1e12)))
    photons = sum(intensity for _, intensity in lines)
    return np.asarray(photons * follow(setting, _NATURAL_HISTORIES, np.random.default_rng(2))[:, 0])


@cache
def natural_field(ground_name: str) -> FloatArray:
    """Return the photon fluxes over ground with its usual activities.

    The result is (H, 2, COLUMNS), as for one series of :func:`natural_series`.
    """
    return np.asarray(np.tensordot(np.array(GROUNDS[ground_name].natural_bq_kg), natural_series(ground_name), 1))


def natural_flux(ground_name: str, height_m: float) -> FloatArray:
    """Return the flux of the ground's own photons at a height, (GROUPS,) by energy group, per m2 and s."""
    return _flux(natural_field(ground_name), height_m)


def rain_flux(ground_name: str, height_m: float) -> FloatArray:
    """Return the flux of photons of radon's daughters at a height, (GROUPS,) by energy group, per m2 and s.

    The amount on the ground adds as much to the air kerma rate 1 m above the ground as dry soil gives.
    """
    scale = natural_field("soil")[_ONE_METRE, :, GROUPS].sum() / rain_field(ground_name)[_ONE_METRE, :, GROUPS].sum()
    return np.asarray(scale * _flux(rain_field(ground_name), height_m))


def _flux(table: FloatArray, height_m: float) -> FloatArray:
    level, above = _between(math.log(max(height_m, _MIN_M)), _LEVELS)
    return np.asarray(((1.0 - above) * table[level] + above * table[level + 1]).sum(axis=0)[:GROUPS])


def _setting(lines: Lines, ground_name: str, source_m: float, depth_m: float, rings: FloatArray) -> Setting:
    energy, intensity = np.array(lines).T
    cumulative = np.cumsum(intensity) / intensity.sum()
    return Setting(energy, cumulative, source_m, depth_m, LEVELS_M, rings, air(), ground(ground_name), kerma_per_fluence())


def _cached(name: str, make: Callable[[], FloatArray]) -> FloatArray:
    """A table, valid for the code that made it."""
    code = hashlib.blake2b(digest_size=8)
    for module in _MADE_BY:
        code.update(Path(__file__).with_name(f"{module}.py").read_bytes())
    return np.asarray(kept(f"ground-{name}-{code.hexdigest()}", lambda: {"table": make()})["table"])
