"""Photons that do not come straight from the source: natural background, and what ground, mount and air scatter into the sensor.

Both arrive evenly from all directions, a simplification: real background is brighter from below, and scattered photons favour the
source's side.
"""

from __future__ import annotations

import numpy as np

from radron.sim.radiation.materials import ELECTRON_MASS_KEV
from radron.sim.radiation.nuclides import Nuclide

Lines = tuple[tuple[float, float], ...]

_CONTINUUM_KEV = (30.0, 1500.0)
_NATURAL_LINES: Lines = ((351.9, 0.02), (583.2, 0.02), (609.3, 0.03), (911.2, 0.02), (1120.3, 0.02), (1460.8, 0.06))


def background_lines(count: int = 60) -> Lines:
    """Return energies (keV) and relative intensities of the natural background: a continuum and the lines of K, U and Th.

    The continuum falls as E^-0.7, so that of 1.5 hits/s about 0.03 lie near 662 keV and 0.005 are coincidences that sum to it,
    the project's reference.
    """
    energy = np.geomspace(*_CONTINUUM_KEV, count)
    weight = energy**0.3  # E^-0.7 over logarithmic steps
    continuum = tuple(zip(energy.tolist(), (0.85 * weight / weight.sum()).tolist(), strict=True))
    return continuum + tuple((line, 0.15 * share / 0.17) for line, share in _NATURAL_LINES)


def scattered_lines(nuclide: Nuclide, angles: int = 16) -> Lines:
    """Return energies (keV) and intensities of a nuclide's photons after one Compton scatter (Klein-Nishina).

    The scattering angles are in even steps of the cosine.
    """
    cosine = (np.arange(angles) + 0.5) * 2.0 / angles - 1.0
    lines: list[tuple[float, float]] = []
    for energy, intensity in nuclide.lines:
        ratio = 1.0 / (1.0 + energy / ELECTRON_MASS_KEV * (1.0 - cosine))
        weight = ratio**2 * (ratio + 1.0 / ratio - 1.0 + cosine**2)
        weight *= intensity / weight.sum()
        lines += zip((energy * ratio).tolist(), weight.tolist(), strict=True)
    return tuple(lines)
