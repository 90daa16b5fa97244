"""Flux of scattered photons per activity on the ground, as far away as contaminated ground still counts.

A table of ``photons.follow`` as in ``field``, for one place of the source, with rings to 150 heights: half of the scattered
photons of an infinite plane come from beyond 50 m, 25 heights of a low flight.
"""

from __future__ import annotations

import hashlib
import math
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radron.sim.radiation.ground.materials import air, ground, kerma_per_fluence
from radron.sim.radiation.ground.photons import Setting, follow
from radron.sim.radiation.nuclides import nuclide
from radron.sim.radiation.store import kept

FloatArray = NDArray[np.float64]

LEVELS_M: FloatArray = np.array((0.5, 1.0, 2.0, 3.5, 6.0, 10.0, 17.0, 30.0))
RINGS: FloatArray = np.array((0.0, 0.5, 1.0, 1.5, 2.2, 3.3, 5.0, 8.0, 13.0, 21.0, 34.0, 55.0, 90.0, 150.0))
PLACES: FloatArray = np.arcsinh(np.sqrt(0.5 * (RINGS[1:] ** 2 + RINGS[:-1] ** 2)))  # of the rings, where their mean is right
_HISTORIES = 1_000_000
_MADE_BY = ("areafield", "materials", "photons")


class AreaField:
    """Flux of the scattered photons of one nuclide on, or evenly deep in, one kind of ground."""

    def __init__(self, table: FloatArray) -> None:
        """table: (H, R, 2, COLUMNS) of ``LEVELS_M`` and ``RINGS``, per decay, as of ``photons.follow``."""
        self._table = table

    def at(self, height_m: float) -> FloatArray:
        """Return the flux of scattered photons at a height, times 4 pi D^2, D the distance from the place of the decay.

        The result is (R, 2, COLUMNS), by ring and side, per decay; the last column is the air kerma (Gy m2). Below and above the
        table its lowest and highest level are used.
        """
        places = np.log(LEVELS_M)
        value = float(np.clip(math.log(max(height_m, float(LEVELS_M[0]))), places[0], places[-1]))
        level = min(int(np.searchsorted(places, value, side="right")) - 1, len(places) - 2)
        above = (value - places[level]) / (places[level + 1] - places[level])
        return np.asarray((1.0 - above) * self._table[level] + above * self._table[level + 1])


@cache
def area_field(nuclide_name: str, ground_name: str, depth_m: float) -> AreaField:
    """Return the flux of scattered photons of a nuclide at a depth in the ground, 0 for its surface."""
    energy, intensity = np.array(nuclide(nuclide_name).lines).T
    cumulative = np.cumsum(intensity) / intensity.sum()
    media = (air(), ground(ground_name), kerma_per_fluence())
    setting = Setting(energy, cumulative, -depth_m, 0.0, LEVELS_M, RINGS, *media)
    code = hashlib.blake2b(digest_size=8)
    for module in _MADE_BY:
        code.update(Path(__file__).with_name(f"{module}.py").read_bytes())
    name = f"area-{nuclide_name}-{ground_name}-{depth_m:g}-{code.hexdigest()}"
    per_decay = float(intensity.sum())
    return AreaField(kept(name, lambda: {"table": per_decay * follow(setting, _HISTORIES, np.random.default_rng(1))})["table"])
