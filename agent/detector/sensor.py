"""The agent's sensor model: a 2 mm CdTe slab on a Timepix3, electrons collected at the rear.

The values come from reference data for the MiniPIX TPX3 with CdTe. They are assumptions, and a real camera (or the simulation)
may differ.
"""

from __future__ import annotations

import math
from bisect import bisect_right

ELECTRON_KEV = 510.99895  # rest energy of the electron
CDTE_DENSITY_G_CM3 = 5.85
# Electrons take this time across the full thickness at the maker's largest bias for CdTe, where the calibration gives neither a
# drift time nor a bias. It is a mobility of 1,034 cm2/(V s); the literature has 1,000 to 1,100.
DRIFT_NS, NOMINAL_MM, NOMINAL_BIAS_V = 86.0, 2.0, 450.0
NOISE_KEV = 2.5  # 1 sigma of a cluster's energy: constant part ...
RELATIVE_NOISE = 0.02  # ... and the part proportional to the energy
DOPPLER_MOMENTUM = 4.2 / 137.036  # 68 % limit of the bound electrons' momentum along the photon's momentum transfer, in m c
# 1 sigma of a cluster's centroid about the point of interaction, in each direction. Parts: pixels, drift times, range of the
# fluorescence, and the electron's track, which lengthens with its energy. From transported electrons of 50 to 1100 keV.
PIXELS_MM = 0.045
TRACK_MM, TRACK_KEV, TRACK_POWER = 0.064, 411.0, 1.2

# CdTe, cm2/g: photoelectric (Kissel) and total attenuation, from xraylib 4.3. The two K edges (Cd 26.711, Te 31.814 keV) have a
# row on each side. Beyond 800 keV xraylib gives no total: the Compton part was scaled by Klein-Nishina.
_CDTE = (
    (10.0, 135.4, 138.1),
    (15.0, 44.76, 46.56),
    (20.0, 20.14, 21.44),
    (26.71, 8.934, 9.843),
    (26.712, 28.41, 29.31),
    (31.81, 18.19, 18.92),
    (31.815, 34.11, 34.84),
    (40.0, 18.75, 19.3),
    (50.0, 10.24, 10.67),
    (60.0, 6.195, 6.542),
    (80.0, 2.763, 3.019),
    (100.0, 1.463, 1.671),
    (150.0, 0.456, 0.6072),
    (200.0, 0.1994, 0.3246),
    (250.0, 0.1057, 0.2155),
    (300.0, 0.06352, 0.1628),
    (400.0, 0.02917, 0.1147),
    (500.0, 0.01641, 0.09292),
    (600.0, 0.01049, 0.08042),
    (800.0, 0.005425, 0.066),
    (1000.0, 0.003388, 0.0573),
    (1500.0, 0.00154, 0.0450),
)
_LOG_ENERGY = tuple(math.log(row[0]) for row in _CDTE)
_LOG_PHOTO = tuple(math.log(row[1]) for row in _CDTE)
_LOG_TOTAL = tuple(math.log(row[2]) for row in _CDTE)


def drift_time_ns(thickness_mm: float, bias_v: float) -> float:
    """Return the drift time (ns) of electrons across a sensor with a uniform field: d^2 / (mobility |bias|), d its thickness."""
    return DRIFT_NS * (thickness_mm / NOMINAL_MM) ** 2 * NOMINAL_BIAS_V / abs(bias_v)


def energy_variance(energy_kev: float) -> float:
    """Return the variance (keV2) of the measured energy of a cluster (adjacent pixels hit by one particle).

    Reference: sigma_E = sqrt(2.5^2 + (0.02 E)^2) keV.
    """
    return NOISE_KEV * NOISE_KEV + (RELATIVE_NOISE * energy_kev) ** 2


def position_variance(energy_kev: float) -> float:
    """Return the variance (mm2, of each axis) of the measured position of a cluster (adjacent pixels hit by one electron).

    The variance grows with the energy, since the electron's track gets longer.
    """
    track_mm: float = TRACK_MM * (energy_kev / TRACK_KEV) ** TRACK_POWER
    return PIXELS_MM * PIXELS_MM + track_mm * track_mm


def attenuation_per_mm(energy_kev: float) -> tuple[float, float]:
    """Return the linear photoelectric and total attenuation coefficients (1/mm) of CdTe for photons of this energy.

    Log-log interpolation in a table, extrapolated at both ends.
    """
    x = math.log(energy_kev)
    i = min(max(bisect_right(_LOG_ENERGY, x), 1), len(_LOG_ENERGY) - 1)
    f = (x - _LOG_ENERGY[i - 1]) / (_LOG_ENERGY[i] - _LOG_ENERGY[i - 1])
    photo = math.exp(_LOG_PHOTO[i - 1] + f * (_LOG_PHOTO[i] - _LOG_PHOTO[i - 1]))
    total = math.exp(_LOG_TOTAL[i - 1] + f * (_LOG_TOTAL[i] - _LOG_TOTAL[i - 1]))
    return 0.1 * CDTE_DENSITY_G_CM3 * photo, 0.1 * CDTE_DENSITY_G_CM3 * total
