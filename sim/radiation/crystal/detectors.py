"""Ordinary detectors by name: shape, material, resolution."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from radron.agent.errors import ConfigError
from radron.sim.radiation.crystal.body import bounding_radius, box, cylinder
from radron.sim.radiation.crystal.matter import Elements, Matter, compound, matter
from radron.sim.radiation.crystal.photons import areas
from radron.sim.radiation.crystal.tube import counting_area

FloatArray = NDArray[np.float64]

STEP_KEV = 2.0  # of the deposited energy


@dataclass(frozen=True)
class Detector:
    """An ordinary detector.

    kind: whether it gives spectra or counts alone. about: what it is, for people. shape: (4,) see
    ``radron.sim.radiation.crystal.body``; of a tube the outside. elements: mass fractions of crystal or wall. fwhm_share: full
    width at half maximum of a line at 662 keV over its energy; it falls with the root of the energy. wall_cm: of a tube.
    """

    kind: Literal["spectrum", "counts"]
    about: str
    shape: FloatArray
    elements: Callable[[], Elements]
    density_gcm3: float
    fwhm_share: float = 0.0
    wall_cm: float = 0.0

    def fwhm_kev(self, energy_kev: FloatArray) -> FloatArray:
        """Return the full width at half maximum of a line, keV."""
        return np.asarray(self.fwhm_share * np.sqrt(661.657 * energy_kev))


DETECTORS: dict[str, Detector] = {
    "nai-2x2": Detector(
        "spectrum",
        "NaI(Tl), cylinder of 2 x 2 inch, axis vertical, 7 % at 662 keV",
        cylinder(5.08, 5.08),
        lambda: compound((11, 1), (53, 1)),
        3.67,
        0.07,
    ),
    "csi-1cm3": Detector(
        "spectrum", "CsI(Tl), cube of 1 cm, 8.4 % at 662 keV", box(1, 1, 1), lambda: compound((55, 1), (53, 1)), 4.51, 0.084
    ),
    "czt-1cm3": Detector(
        "spectrum",
        "Cd0.9Zn0.1Te, cube of 1 cm, 2 % at 662 keV, charge collected everywhere",
        box(1, 1, 1),
        lambda: compound((48, 0.9), (30, 0.1), (52, 1)),
        5.78,
        0.02,
    ),
    "gm-sbm20": Detector(
        "counts",
        "Geiger-Mueller tube like SBM-20: steel wall of 50 um, 10 mm x 91 mm, lying",
        cylinder(1.0, 9.1),
        lambda: ((24, 0.18), (26, 0.74), (28, 0.08)),
        7.9,
        wall_cm=0.005,
    ),
}


def detector(name: str) -> Detector:
    """Return the ordinary detector with this name. Raises ConfigError for an unknown one."""
    if name not in DETECTORS:
        raise ConfigError(f"detector {name!r} is not known; known are {', '.join(DETECTORS)}")
    return DETECTORS[name]


@cache
def _matter(name: str) -> Matter:
    return matter(DETECTORS[name].elements(), DETECTORS[name].density_gcm3)


def effective_areas(
    name: str, energy_kev: float, angle_deg: float, histories: int, rng: np.random.Generator
) -> tuple[float, FloatArray]:
    """Return effective areas (cm2) in a parallel flux: of the full energy, and of all else, by deposit in bins of ``STEP_KEV``.

    angle_deg: between the way to the source and straight down, mean over all azimuths. Of a tube, which measures no energy, the
    second array has one number.
    """
    kind, cosine = detector(name), math.cos(math.radians(angle_deg))
    radius = 1.0001 * bounding_radius(kind.shape)
    if kind.kind == "counts":
        inner = cylinder(2.0 * (kind.shape[1] - kind.wall_cm), 2.0 * (kind.shape[3] - kind.wall_cm))
        area = counting_area(energy_kev, cosine, kind.shape, inner, kind.density_gcm3, _matter(name), radius, histories, rng)
        return 0.0, np.array([area])
    bins = math.ceil(energy_kev / STEP_KEV)
    return areas(energy_kev, cosine, kind.shape, _matter(name), radius, histories, STEP_KEV, bins, rng)
