"""Cross sections of the materials of ordinary detectors, 10 keV to 3 MeV, by process.

Photoelectric and incoherent ones as in ``radron.sim.radiation.materials``: xraylib's, continued above 800 keV. Pair production
in the field of the nucleus: Born approximation without screening (Maximon 1968, J. Res. NBS 72B, 79); it is 10 to 20 % low below
2 MeV for heavy elements, where it is under 6 % of the total. Coherent scattering, which deposits no energy, is left out.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import xraylib
from numpy.typing import NDArray

from radron.sim.radiation._jit import jit
from radron.sim.radiation.materials import ELECTRON_MASS_KEV, mass_cross_sections

FloatArray = NDArray[np.float64]
Elements = tuple[tuple[int, float], ...]  # atomic number, mass fraction

MIN_KEV, MAX_KEV = 10.0, 3000.0
GRID = 600
PAIR_THRESHOLD_KEV = 2.0 * ELECTRON_MASS_KEV
_PAIR_CM2 = 5.795e-28  # fine structure constant times the square of the classical electron radius
_AVOGADRO = 6.02214e23


class Matter(NamedTuple):
    """Attenuation of photons in a material, (GRID,) by energy, evenly spaced in its logarithm from MIN_KEV to MAX_KEV.

    per_cm: linear attenuation coefficient, 1/cm. photo, compton: shares of the processes; the rest is pair production.
    """

    per_cm: FloatArray
    photo: FloatArray
    compton: FloatArray


def pair_cm2(element: int, energy_kev: float) -> float:
    """Return the cross section of pair production by a nucleus, cm2 per atom (Maximon 1968, eq. for photons below 2 MeV)."""
    if energy_kev <= PAIR_THRESHOLD_KEV:
        return 0.0
    k = energy_kev / ELECTRON_MASS_KEV
    rho = (2.0 * k - 4.0) / (k + 2.0 + 2.0 * math.sqrt(2.0 * k))
    series = 1.0 + rho / 2.0 + 23.0 * rho**2 / 40.0 + 11.0 * rho**3 / 60.0 + 29.0 * rho**4 / 960.0
    return _PAIR_CM2 * element**2 * 2.0 * math.pi / 3.0 * ((k - 2.0) / k) ** 3 * series


def matter(elements: Elements, density_gcm3: float) -> Matter:
    """Return the cross sections of a compound or mixture of this density."""
    energies = np.geomspace(MIN_KEV, MAX_KEV, GRID)
    photo, compton, pair = np.zeros(GRID), np.zeros(GRID), np.zeros(GRID)
    for element, share in elements:
        parts = np.array([mass_cross_sections(element, float(energy)) for energy in energies])
        photo += share * parts[:, 0]
        compton += share * parts[:, 1]
        per_gram = _AVOGADRO / xraylib.AtomicWeight(element)
        pair += share * per_gram * np.array([pair_cm2(element, float(energy)) for energy in energies])
    total = photo + compton + pair
    return Matter(total * density_gcm3, photo / total, compton / total)


def compound(*atoms: tuple[int, float]) -> Elements:
    """Return the mass fractions of a compound, given as (atomic number, number of atoms)."""
    weights = [number * xraylib.AtomicWeight(element) for element, number in atoms]
    return tuple((element, weight / sum(weights)) for (element, _), weight in zip(atoms, weights, strict=True))


@jit
def at(energy_kev: float, values: FloatArray) -> float:
    """Interpolate a table of ``Matter`` at an energy; constant beyond its ends."""
    place = math.log(energy_kev / MIN_KEV) * ((GRID - 1) / math.log(MAX_KEV / MIN_KEV))
    cell = max(0, min(GRID - 2, int(place)))
    part = min(max(place - cell, 0.0), 1.0)
    return float(values[cell] * (1.0 - part) + values[cell + 1] * part)
