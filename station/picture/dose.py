"""Dose rates from the posterior: the expected dose rate of a person at 1 m above the ground, over all possible sources.

The ambient dose equivalent rate at the distance r of a point source is H = C A / r^2; attenuation in air and build-up by
scatter, which work against each other, are left out. C is the sum over the nuclide's lines above 50 keV of the photons per decay
times the conversion coefficient h*(10) of ICRP Publication 74, Table A.21, over 4 pi.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

HEIGHT_M = 1.0
# uSv m2 / (h MBq); ``tests/station/picture/test_dose.py`` computes them from lines and coefficients.
CONSTANTS = {
    "Am-241": 0.0053,
    "Ba-133": 0.0627,
    "Co-57": 0.0205,
    "Co-60": 0.3482,
    "Cs-137": 0.0909,
    "Eu-152": 0.1563,
    "F-18": 0.1655,
    "I-131": 0.0635,
    "Ir-192": 0.1347,
    "K-40": 0.0205,
    "Na-22": 0.3303,
    "Se-75": 0.0658,
}


def rate_usvph(nuclide: str, activity_bq: float, distance_m: float = 1.0) -> float | None:
    """Return the ambient dose equivalent rate (uSv/h) of a point source at a distance.

    Return None for a nuclide without a known dose rate constant.
    """
    constant = CONSTANTS.get(nuclide)
    return None if constant is None else constant * activity_bq * 1e-6 / distance_m**2


def expected_usvph(
    nuclide: str, sources: NDArray[np.float64], activity_bq: NDArray[np.float64], places: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Return the expected dose rate at several places, averaged over all places where the source may be (uSv/h).

    Args:
        nuclide: the nuclide; without a known dose rate constant the result is None.
        sources: (C, 2) possible source positions on the ground, metres.
        activity_bq: (C,) activity at each of these positions, already multiplied by the position's probability.
        places: (N, 2) ground positions; the dose rate is computed 1 m above them.

    Returns:
        (N,) dose rates.
    """
    constant = CONSTANTS.get(nuclide)
    if constant is None:
        return None
    squared = (places**2).sum(1)[:, None] + (sources**2).sum(1) - 2.0 * places @ sources.T
    rates: NDArray[np.float64] = constant * 1e-6 * (1.0 / (squared + HEIGHT_M**2)) @ activity_bq
    return rates
