"""Grounds and air for the transport of photons: composition, density, natural activity, cross sections.

Soil is after the typical one of Saito and Jacob (1995, Radiat. Prot. Dosim. 58, 29), moist; concrete is NIST's ordinary one, sand
dry silica, asphalt silica with 6 % of bitumen (CH2). Activities are round figures of UNSCEAR (2000), Annex B: 400 / 35 / 30 Bq/kg
of K-40, U-238 and Th-232 series are the medians of soils. Coherent scattering, which hardly turns a photon, and pair production
are neglected.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
import xraylib
from numpy.typing import NDArray

from radron.sim.radiation.materials import AIR, AIR_DENSITY_GCM3, CONTINUED_FROM_KEV, ELECTRON_MASS_KEV, XRAYLIB_LIMIT_KEV

FloatArray = NDArray[np.float64]

MIN_GRID_KEV, MAX_GRID_KEV = 20.0, 3000.0
GRID = 500
_JOULE_PER_KEV = 1.602177e-16


@dataclass(frozen=True, slots=True)
class Ground:
    """A kind of ground.

    elements: (atomic number, mass fraction). natural_bq_kg: activities of K-40, the U-238 series and the Th-232 series.
    """

    name: str
    density_gcm3: float
    elements: tuple[tuple[int, float], ...]
    natural_bq_kg: tuple[float, float, float]


_SOIL = ((1, 0.017), (8, 0.557), (13, 0.087), (14, 0.267), (19, 0.017), (20, 0.01), (26, 0.045))
_ASPHALT = ((1, 0.0086), (6, 0.0514), (8, 0.501), (14, 0.439))
_CONCRETE = (
    *((1, 0.010), (6, 0.001), (8, 0.529), (11, 0.016), (12, 0.002), (13, 0.034), (14, 0.337), (19, 0.013), (20, 0.044)),
    (26, 0.014),
)
GROUNDS: dict[str, Ground] = {
    ground.name: ground
    for ground in (
        Ground("soil", 1.5, _SOIL, (400.0, 35.0, 30.0)),
        Ground("sand", 1.6, ((8, 0.533), (14, 0.467)), (250.0, 12.0, 12.0)),
        Ground("asphalt", 2.3, _ASPHALT, (350.0, 25.0, 25.0)),
        Ground("concrete", 2.3, _CONCRETE, (400.0, 40.0, 30.0)),
        Ground("water", 1.0, ((1, 0.1119), (8, 0.8881)), (0.0, 0.0, 0.0)),
    )
}


def concrete_per(kind: str) -> float:
    """Return the length of concrete that attenuates gamma rays as much as 1 m of this ground: attenuation is by mass."""
    return GROUNDS[kind].density_gcm3 / GROUNDS["concrete"].density_gcm3


class Medium(NamedTuple):
    """Attenuation of photons in a material, (GRID,) by energy.

    attenuation: per metre, all interactions. compton: the share of Compton scattering.
    """

    attenuation: FloatArray
    compton: FloatArray


def energies_kev() -> FloatArray:
    """Return the energies of all tables, (GRID,) keV, evenly spaced in their logarithm."""
    return np.geomspace(MIN_GRID_KEV, MAX_GRID_KEV, GRID)


def _mass_cross_sections(element: int, energy_kev: float) -> tuple[float, float]:
    """Photoelectric and incoherent mass attenuation, cm2/g; continued above xraylib's end as in
    ``radron.sim.radiation.materials``."""
    if energy_kev <= XRAYLIB_LIMIT_KEV:
        return xraylib.CS_Photo(element, energy_kev), xraylib.CS_Compt(element, energy_kev)
    photo, incoherent = _mass_cross_sections(element, XRAYLIB_LIMIT_KEV)
    slope = np.log(photo / xraylib.CS_Photo(element, CONTINUED_FROM_KEV)) / np.log(XRAYLIB_LIMIT_KEV / CONTINUED_FROM_KEV)
    falls = _klein_nishina(energy_kev)[0] / _klein_nishina(XRAYLIB_LIMIT_KEV)[0]
    return float(photo * (energy_kev / XRAYLIB_LIMIT_KEV) ** slope), incoherent * falls


def _medium(elements: tuple[tuple[int, float], ...], density_gcm3: float) -> Medium:
    parts = np.array([[_mass_cross_sections(z, float(e)) for e in energies_kev()] for z, _ in elements])  # (elements, GRID, 2)
    photo, compton = np.einsum("e,egp->pg", [share for _, share in elements], parts) * 100.0 * density_gcm3
    return Medium(photo + compton, compton / (photo + compton))


@cache
def air() -> Medium:
    """Return the attenuation of photons in dry air at 20 C and 1 atm."""
    return _medium(AIR, AIR_DENSITY_GCM3)


@cache
def ground(name: str) -> Medium:
    """Return the attenuation of photons in a kind of ground."""
    return _medium(GROUNDS[name].elements, GROUNDS[name].density_gcm3)


@cache
def kerma_per_fluence() -> FloatArray:
    """Return the air kerma per photon fluence, (GRID,) by energy, Gy m2: the energy that photons transfer to electrons."""
    energy = energies_kev()
    mass = air().attenuation / (100.0 * AIR_DENSITY_GCM3)  # cm2/g
    photo, compton = mass * (1.0 - air().compton), mass * air().compton
    transferred = photo + compton * np.array([_klein_nishina(float(e))[1] for e in energy])
    return np.asarray(energy * _JOULE_PER_KEV * transferred * 0.1)


@cache
def _klein_nishina(energy_kev: float) -> tuple[float, float]:
    """Total cross section of a free electron (any unit), and the mean share of its energy that a photon gives to it."""
    cosine = np.linspace(-1.0, 1.0, 4001)
    ratio = 1.0 / (1.0 + energy_kev / ELECTRON_MASS_KEV * (1.0 - cosine))
    weight = ratio**2 * (ratio + 1.0 / ratio - 1.0 + cosine**2)
    return float(np.mean(weight)), float(np.sum(weight * (1.0 - ratio)) / np.sum(weight))
