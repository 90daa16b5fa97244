"""Cross sections of cadmium telluride and of air, from xraylib, tabulated for the compiled transport.

xraylib's tables end at 800 keV. Above, the photoelectric cross section is continued by its power law, the incoherent one by
Klein-Nishina's total cross section, the coherent one as E^-2. Pair production (under 3 % of the cross section up to 1.5
MeV) is left out.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import xraylib
from numpy.typing import NDArray

ELECTRON_MASS_KEV = 510.99895
CDTE_DENSITY_GCM3 = 5.85
AIR_DENSITY_GCM3 = 1.205e-3
ELEMENTS = (48, 52)  # Cd, Te

XRAYLIB_LIMIT_KEV = 799.0
CONTINUED_FROM_KEV = 500.0
AIR = ((7, 0.7552), (8, 0.2314), (18, 0.0134))  # mass fractions of N, O, Ar
_K_LINES = ("KL3_LINE", "KL2_LINE", "KM3_LINE", "KM2_LINE", "KN3_LINE", "KN2_LINE")
_SHELLS = 30

FloatArray = NDArray[np.float64]


class CdTe(NamedTuple):
    """Cross sections of the sensor material cadmium telluride, as tables for the compiled transport.

    Sizes: 2 elements (Cd, Te), G energies, S shells, Q quantiles, X momentum transfers. log_energy: (G,) natural log of keV,
    evenly spaced. attenuation: (G,) per mm. photo, compton: (G,) shares of the total (the rest is Rayleigh). photo_te,
    compton_te, rayleigh_te: (G,) share of tellurium in each process. k_share: (2, G) share of the photoelectric absorptions that
    leave a vacancy in the K shell. k_edge_kev, k_yield: (2,) edge and fluorescence yield. k_line_kev, k_line_cumulative: (2, 6)
    fluorescence lines and their cumulative shares. shell_cumulative, shell_edge_kev: (2, S). momentum: (2, S, Q) quantiles of an
    electron's momentum component, units of m c. transfer: (X,) momentum transfer sin(angle/2)/wavelength, 1/angstrom. incoherent:
    (2, X) S/Z. form_squared: (2, X) cumulative of F^2 over the square of the transfer (not normalised).
    """

    log_energy: FloatArray
    attenuation: FloatArray
    photo: FloatArray
    compton: FloatArray
    photo_te: FloatArray
    compton_te: FloatArray
    rayleigh_te: FloatArray
    k_share: FloatArray
    k_edge_kev: FloatArray
    k_yield: FloatArray
    k_line_kev: FloatArray
    k_line_cumulative: FloatArray
    shell_cumulative: FloatArray
    shell_edge_kev: FloatArray
    momentum: FloatArray
    transfer: FloatArray
    incoherent: FloatArray
    form_squared: FloatArray


def _klein_nishina_total(energy_kev: float) -> float:
    """Total cross section of a free electron, in units of the squared classical electron radius."""
    k = energy_kev / ELECTRON_MASS_KEV
    log = np.log1p(2.0 * k)
    first = (1.0 + k) / k**2 * (2.0 * (1.0 + k) / (1.0 + 2.0 * k) - log / k)
    return float(2.0 * np.pi * (first + log / (2.0 * k) - (1.0 + 3.0 * k) / (1.0 + 2.0 * k) ** 2))


def mass_cross_sections(element: int, energy_kev: float) -> tuple[float, float, float]:
    """Return photoelectric, incoherent and coherent mass attenuation of an element, cm2/g."""
    if energy_kev <= XRAYLIB_LIMIT_KEV:
        return xraylib.CS_Photo(element, energy_kev), xraylib.CS_Compt(element, energy_kev), xraylib.CS_Rayl(element, energy_kev)
    top, low = XRAYLIB_LIMIT_KEV, CONTINUED_FROM_KEV
    photo, incoherent, coherent = mass_cross_sections(element, top)
    slope = np.log(photo / xraylib.CS_Photo(element, low)) / np.log(top / low)
    return (
        float(photo * (energy_kev / top) ** slope),
        incoherent * _klein_nishina_total(energy_kev) / _klein_nishina_total(top),
        coherent * (top / energy_kev) ** 2,
    )


def air_attenuation_per_m(energy_kev: float) -> float:
    """Return the linear attenuation coefficient of dry air at 20 C and 1 atm for gamma rays, per metre."""
    return 100.0 * AIR_DENSITY_GCM3 * sum(share * sum(mass_cross_sections(element, energy_kev)) for element, share in AIR)


def _momentum_quantiles(element: int, shell: int, count: int) -> FloatArray:
    """Quantiles of the momentum component of an electron of that shell (its Compton profile), units of m c."""
    atomic_units = np.concatenate(([0.0], np.geomspace(1e-3, 99.0, 400)))
    profile = np.array([xraylib.ComptonProfile_Partial(element, shell, float(p)) for p in atomic_units])
    half = np.concatenate(([0.0], np.cumsum(0.5 * (profile[1:] + profile[:-1]) * np.diff(atomic_units))))
    level = 2.0 * (np.arange(count) + 0.5) / count - 1.0
    quantiles: FloatArray = np.sign(level) * np.interp(np.abs(level) * half[-1], half, atomic_units) / 137.035999
    return quantiles


def _shells(element: int, quantiles: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Cumulative occupation, binding energies and momenta of the shells; padded with empty ones."""
    occupation = np.zeros(_SHELLS)
    edge = np.zeros(_SHELLS)
    momentum = np.zeros((_SHELLS, quantiles))
    for shell in range(_SHELLS):
        try:
            occupation[shell] = xraylib.ElectronConfig(element, shell)
            edge[shell] = xraylib.EdgeEnergy(element, shell)
            momentum[shell] = _momentum_quantiles(element, shell, quantiles)
        except ValueError:  # the element has no such shell
            occupation[shell] = 0.0
    cumulative = np.cumsum(occupation)
    return cumulative / cumulative[-1], edge, momentum


@cache
def cdte(grid: int = 1500, quantiles: int = 256) -> CdTe:
    """Return the cross sections of CdTe (equal numbers of Cd and Te atoms) as tables from 3 keV to 1.6 MeV.

    grid: number of energies. quantiles: number of quantiles of the electrons' momentum.
    """
    log_energy = np.linspace(np.log(3.0), np.log(1600.0), grid)
    weights = np.array([xraylib.AtomicWeight(element) for element in ELEMENTS])
    weights /= weights.sum()
    # (process, element, energy) partial mass attenuation
    parts = np.array([[mass_cross_sections(z, float(np.exp(e))) for e in log_energy] for z in ELEMENTS]).transpose(2, 0, 1)
    parts *= weights[None, :, None]
    by_process = parts.sum(axis=1)
    total = by_process.sum(axis=0)

    edges = np.array([xraylib.EdgeEnergy(z, xraylib.K_SHELL) for z in ELEMENTS])
    jumps = np.array([xraylib.JumpFactor(z, xraylib.K_SHELL) for z in ELEMENTS])
    k_share = np.where(np.exp(log_energy)[None, :] > edges[:, None], 1.0 - 1.0 / jumps[:, None], 0.0)
    codes = [getattr(xraylib, name) for name in _K_LINES]
    rates = np.array([[xraylib.RadRate(z, code) for code in codes] for z in ELEMENTS])

    shells = [_shells(z, quantiles) for z in ELEMENTS]
    transfer = np.concatenate(([0.0], np.geomspace(1e-3, 130.0, 600)))
    incoherent = np.array([[0.0] + [xraylib.SF_Compt(z, float(x)) / z for x in transfer[1:]] for z in ELEMENTS])
    squared = np.array([[xraylib.FF_Rayl(z, float(x)) ** 2 for x in transfer] for z in ELEMENTS])
    step = np.diff(transfer**2)
    form = np.concatenate((np.zeros((2, 1)), np.cumsum(0.5 * (squared[:, 1:] + squared[:, :-1]) * step, axis=1)), axis=1)
    return CdTe(
        log_energy=log_energy,
        attenuation=total * CDTE_DENSITY_GCM3 / 10.0,
        photo=by_process[0] / total,
        compton=by_process[1] / total,
        photo_te=parts[0, 1] / by_process[0],
        compton_te=parts[1, 1] / by_process[1],
        rayleigh_te=parts[2, 1] / by_process[2],
        k_share=k_share,
        k_edge_kev=edges,
        k_yield=np.array([xraylib.FluorYield(z, xraylib.K_SHELL) for z in ELEMENTS]),
        k_line_kev=np.array([[xraylib.LineEnergy(z, code) for code in codes] for z in ELEMENTS]),
        k_line_cumulative=np.cumsum(rates, axis=1) / rates.sum(axis=1, keepdims=True),
        shell_cumulative=np.array([s[0] for s in shells]),
        shell_edge_kev=np.array([s[1] for s in shells]),
        momentum=np.array([s[2] for s in shells]),
        transfer=transfer,
        incoherent=np.minimum(incoherent, 1.0),
        form_squared=form,
    )
