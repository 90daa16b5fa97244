"""Attenuation of gamma rays by concrete: cross sections from xraylib, composition and density of Portland concrete (NIST)."""

from __future__ import annotations

from functools import cache

import xraylib

from radron.sim.radiation.materials import air_attenuation_per_m

_CONCRETE = xraylib.GetCompoundDataNISTByName("Concrete, Portland")
_TABLES_END_KEV = 799.0


@cache
def concrete_attenuation_per_m(energy_kev: float) -> float:
    """Return the linear attenuation coefficient of concrete (2.3 g/cm3) for gamma rays, per metre.

    xraylib's tables end at 800 keV. Above, nearly all interactions are Compton scattering, whose dependence on energy is common
    to all materials, so that the coefficient is scaled like air's.
    """
    if energy_kev > _TABLES_END_KEV:
        falls = air_attenuation_per_m(energy_kev) / air_attenuation_per_m(_TABLES_END_KEV)
        return concrete_attenuation_per_m(_TABLES_END_KEV) * falls
    parts = zip(_CONCRETE["Elements"], _CONCRETE["massFractions"], strict=True)
    return float(100.0 * _CONCRETE["density"] * sum(share * xraylib.CS_Total(element, energy_kev) for element, share in parts))
