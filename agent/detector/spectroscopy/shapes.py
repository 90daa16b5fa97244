"""The components of a spectrum of event energies, as shares of the events in each bin (B,)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.special import erf, erfcx

from radron.agent.detector.cones import compton_edge_kev, klein_nishina_recoil
from radron.agent.detector.lines import GAMMAS, lines_of
from radron.agent.detector.sensor import attenuation_per_mm, energy_variance
from radron.agent.geometry import Array

EDGES_KEV: Array = np.geomspace(45.0, 1600.0, 141)  # 2.6 % wide: one standard deviation of the resolution
MIDDLES_KEV: Array = np.sqrt(EDGES_KEV[1:] * EDGES_KEV[:-1])
_HUMPS = 9

# Effective area for full-energy events, mm2, mean over all directions, by energy in keV, for photons that the simulated sensor
# turns into a peak of the agent's resolution.
_PEAK_KEV = (60.0, 80.0, 120.0, 160.0, 210.0, 280.0, 365.0, 470.0, 600.0, 760.0, 960.0, 1173.0, 1400.0)
_PEAK_MM2 = (75.5, 81.3, 70.6, 50.4, 31.1, 17.0, 9.48, 5.50, 3.27, 1.97, 1.21, 0.786, 0.535)

# Strongest lines of the natural background by series, keV and photons per decay (Decay Data Evaluation Project).
_NATURAL: tuple[tuple[tuple[float, float], ...], ...] = (
    ((1460.82, 0.1055),),
    ((295.22, 0.184), (351.93, 0.356), (609.31, 0.455), (768.36, 0.049), (1120.29, 0.149), (1238.12, 0.058)),
    ((238.63, 0.436), (338.32, 0.114), (583.19, 0.306), (727.33, 0.067), (911.20, 0.262), (968.96, 0.159)),
)


@dataclass(frozen=True, slots=True)
class Reading:
    """The way in which a camera reads energies: deviation of its gain, and charge that it loses.

    gain: relative to the calibration; 1 is right. loss_kev: mean of the charge below the pixels' thresholds, which is lost; it is
    exponentially distributed. The simulated sensor loses 4 keV, other models of the same sensor about 8 keV.
    """

    gain: float = 1.0
    loss_kev: float = 4.0


NOMINAL = Reading()


def peak_area_mm2(energy_kev: float) -> float:
    """Return the effective area (mm2) of the camera for photons that deposit their full energy, mean over all directions."""
    return float(np.exp(np.interp(np.log(energy_kev), np.log(_PEAK_KEV), np.log(_PEAK_MM2))))


def strongest_line_kev(nuclide: str) -> float:
    """Return the line (keV) of a nuclide that gives the most full-energy events. Raises ConfigError for an unknown nuclide."""
    photons = dict(GAMMAS.get(nuclide, ()))
    return max(lines_of(nuclide), key=lambda line: photons.get(line, 0.0) * peak_area_mm2(line))


def peaks(lines: Iterable[tuple[float, float]], reading: Reading = NOMINAL) -> Array:
    """Return the spectrum (B,) of the full-energy peaks of gamma lines, as shares of the events in B energy bins.

    lines: pairs of energy (keV) and photons per decay; the sensor's efficiency at each energy is taken into account.
    """
    shape = np.zeros(len(MIDDLES_KEV))
    for energy, photons in lines:
        area = peak_area_mm2(energy)
        shape += (
            photons * area * np.diff(lossy(EDGES_KEV / reading.gain - energy, energy_variance(energy) ** 0.5, reading.loss_kev))
        )
    return _normalised(shape)


def continuum(lines: Iterable[tuple[float, float]], reading: Reading = NOMINAL) -> Array:
    """Return the Compton continuum (B,) of gamma lines, as shares of the events in B energy bins.

    It is the spectrum of the recoil electrons of photons that scattered once and escaped. lines: pairs of energy (keV) and
    photons per decay.
    """
    shape = np.zeros(len(MIDDLES_KEV))
    for energy, photons in lines:
        electron, sigma, spectrum = _recoils(energy)
        shape += np.diff(_normal((EDGES_KEV[:, None] / reading.gain - electron) / sigma), axis=0) @ (photons * spectrum)
    return _normalised(shape)


@cache
def _recoils(energy_kev: float) -> tuple[Array, Array, Array]:
    """Energies (keV) of the recoil electrons of a line, their resolution, and their number: the line's attenuation by scatter."""
    photo, total = attenuation_per_mm(energy_kev)
    edge = compton_edge_kev(energy_kev)
    electron: Array = np.array([(step + 0.5) * edge / 200.0 for step in range(200)])
    spectrum: Array = np.array([klein_nishina_recoil(energy_kev, float(kev)) for kev in electron])
    sigma: Array = np.array([energy_variance(float(kev)) ** 0.5 for kev in electron])
    scattered: Array = spectrum * ((total - photo) / spectrum.sum())
    return electron, sigma, scattered


def surroundings(reading: Reading = NOMINAL) -> Array:
    """Return K spectra (K, B) that any measured spectrum may contain beside those of the source, over B energy bins.

    They are the lines of the natural background, one spectrum for each decay series; and broad humps, triangles over the
    logarithm of the energy that add up to a constant, for scattered photons and the background's continuum.
    """
    middle = np.log(MIDDLES_KEV)
    centre = np.linspace(middle[0], middle[-1], _HUMPS)
    height = np.maximum(1.0 - np.abs(middle - centre[:, None]) / (centre[1] - centre[0]), 0.0)
    return np.array([peaks(lines, reading) for lines in _NATURAL] + [_normalised(one) for one in height])


def of_nuclide(lines: Sequence[tuple[float, float]], reading: Reading = NOMINAL) -> Array:
    """Return the two spectra (2, B) of a nuclide with these gamma lines over B energy bins: full-energy peaks and Compton
    continuum.
    """
    return np.array([peaks(lines, reading), continuum(lines, reading)])


def _normalised(shape: Array) -> Array:
    """The shape scaled to a sum of 1; zero stays zero."""
    result: Array = shape / max(float(shape.sum()), 1e-300)
    return result


def _normal(z: Array) -> Array:
    """Cumulative normal distribution."""
    result: Array = 0.5 * (1.0 + erf(z / np.sqrt(2.0)))
    return result


def lossy(above_kev: Array, sigma_kev: float, loss_kev: float) -> Array:
    """Return the probability that the energy read is below a limit: a normal distribution, shifted by an exponentially
    distributed loss.

    above_kev: the limit, less the line's energy. sigma_kev: resolution, 1 sigma. loss_kev: mean of the loss.
    """
    z = np.maximum(above_kev / sigma_kev, -30.0)  # beyond it there is nothing, and erfcx overflows
    tail = 0.5 * np.exp(-0.5 * z**2) * erfcx((z + sigma_kev / loss_kev) / np.sqrt(2.0))
    result: Array = _normal(z) + tail
    return result
