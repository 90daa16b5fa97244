"""A coincidence as a Compton cone, in both orders: which of the two clusters was the recoil electron is unknown.

Kinematics: paper, Eqs. (1)-(3), with the energies fitted to the line. Probabilities and widths start from the formulas of the
project's estimation reference ("Beyond").
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from radron.agent.detector.detection import ConeEvent
from radron.agent.detector.sensor import DOPPLER_MOMENTUM, ELECTRON_KEV, attenuation_per_mm, energy_variance, position_variance

ORDER_FLOOR = 0.03  # least probability of each order, for effects that the weights do not model
SIGMA_MAX_RAD = 0.35
SIGMA_FLOOR_RAD = 0.02
# Beyond the Compton edge: the share, and the 1-sigma width of the core, of events that the Doppler broadening of inner shells and
# several scatters in one cluster put there. Fitted to transported Cs-137 events so that the probabilities are calibrated.
TAIL, TAIL_WIDTH = 0.15, 7.0
# mean true position, in 1 sigma below the edge, of transported Cs-137 and I-131 events near the edge and beyond it
BELOW_EDGE = 1.0


@dataclass(frozen=True, slots=True)
class Line:
    """A gamma line, and the limits of measured energies within which a pair of clusters can be a Compton event of this line, keV.

    A coincidence (two clusters of one photon) makes a cone only if, in one order of its two interactions, the measured electron
    energy is at most ``maximum_electron_kev`` and the measured photon energy at least ``minimum_photon_kev`` (the predecessor's
    selection). The other order is then kept too, with its probability: near the edge the energy noise decides which one passes.
    """

    energy_kev: float
    maximum_electron_kev: float
    minimum_photon_kev: float

    @classmethod
    def of(cls, energy_kev: float, maximum_electron_kev: float | None = None, minimum_photon_kev: float | None = None) -> Line:
        """Return the line of this energy; limits default to its Compton edge, and to the energy of a backscattered photon less 10
        keV.
        """
        edge = compton_edge_kev(energy_kev)
        return cls(
            energy_kev,
            edge if maximum_electron_kev is None else maximum_electron_kev,
            max(energy_kev - edge - 10.0, 1.0) if minimum_photon_kev is None else minimum_photon_kev,
        )

    def allows(self, electron_kev: float, photon_kev: float) -> bool:
        """Return whether these measured energies (keV) of electron and scattered photon are within the line's limits."""
        return electron_kev <= self.maximum_electron_kev and photon_kev >= self.minimum_photon_kev


def compton_edge_kev(energy_kev: float) -> float:
    """Return the Compton edge: the largest energy (keV) that a photon can give to an electron, when scattered by 180 degrees."""
    return energy_kev / (1.0 + ELECTRON_KEV / (2.0 * energy_kev))


def klein_nishina_recoil(energy_kev: float, electron_kev: float) -> float:
    """Return the Klein-Nishina differential cross section by the electron's recoil energy T, dsigma/dT.

    The constant factor pi r_e^2 / m c^2 is left out. energy_kev: of the photon. electron_kev: recoil energy.
    """
    alpha = energy_kev / ELECTRON_KEV
    s = electron_kev / energy_kev
    q = s / (1.0 - s)
    return (2.0 + q * q / (alpha * alpha) + q * (s - 2.0 / alpha)) / (alpha * alpha)


def _cosine(energy_kev: float, photon_kev: float) -> float:
    """Cosine of the scattering angle; below -1 where the photon has less energy than a scatter can leave it."""
    return 1.0 + ELECTRON_KEV * (1.0 / energy_kev - 1.0 / photon_kev)


def doppler_kev(energy_kev: float, photon_kev: float, cosine: float) -> float:
    """Return the Doppler broadening, 1 sigma (keV), of the energy of a photon scattered at a given angle.

    It comes from the momentum p of the bound electron: p |k - k'| E' / (m c E), with k, E and k', E' momentum and energy of the
    photon before and after. energy_kev: E. photon_kev: E'. cosine: of the scattering angle.
    """
    transfer = math.sqrt(energy_kev * energy_kev + photon_kev * photon_kev - 2.0 * energy_kev * photon_kev * cosine)
    return DOPPLER_MOMENTUM * transfer * photon_kev / energy_kev


def cone_event(
    stamp_ns: int, energies_kev: tuple[float, float], separation_mm: tuple[float, float, float], line: Line
) -> ConeEvent:
    """Return the Compton cone of a coincidence, with both orders of the two interactions.

    ``separation_mm``: position of cluster 1 minus cluster 2, camera frame. ``line``: the photon's gamma line.

    The difference between the line's energy and the measured sum is divided between the two energies in proportion to their
    variances v1 and v2, so that they add up to the line. Both then have the variance v = v1 v2 / (v1 + v2). At least one order
    must be allowed by the line.
    """
    measured_1, measured_2 = energies_kev
    variance_1, variance_2 = energy_variance(measured_1), energy_variance(measured_2)
    share = variance_1 / (variance_1 + variance_2)
    fitted_1 = measured_1 + (line.energy_kev - measured_1 - measured_2) * share
    fitted_1 = min(max(fitted_1, 1.0), line.energy_kev - 1.0)
    fitted_2 = line.energy_kev - fitted_1
    variance = variance_2 * share
    x, y, z = separation_mm
    length = max(math.sqrt(x * x + y * y + z * z), 1e-3)
    x, y, z = x / length, y / length, z / length

    theta_1, sigma_1, weight_1 = _reading(line, fitted_1, variance, length)
    theta_2, sigma_2, weight_2 = _reading(line, fitted_2, variance, length)
    total = weight_1 + weight_2
    if weight_1 == 0.0 or weight_2 == 0.0:
        first = weight_1 / total if total > 0.0 else 0.5
    else:
        first = ORDER_FLOOR + (1.0 - 2.0 * ORDER_FLOOR) * weight_1 / total
    sigma = math.sqrt(variance)
    return ConeEvent(
        stamp_ns=stamp_ns,
        axis=np.array(((x, y, z), (-x, -y, -z))),
        theta_rad=np.array((theta_1, theta_2)),
        sigma_rad=np.array((sigma_1, sigma_2)),
        probability=np.array((first, 1.0 - first)),
        energies_kev=(fitted_1, fitted_2),
        energy_sigmas_kev=(sigma, sigma),
        separation_mm=length,
    )


def _reading(line: Line, electron_kev: float, variance: float, length_mm: float) -> tuple[float, float, float]:
    """Opening angle, its 1 sigma (ARM) in rad, and the weight of one order; the energies add up to the line.

    The weight is the Klein-Nishina cross section for the recoil energy times the probability that the scattered photon is
    absorbed at this distance. Beyond the Compton edge it is a Gaussian of the resolution. Near the edge and beyond, the energy
    only shows that the photon was scattered back, and few directions lie exactly behind. The angle is then that of BELOW_EDGE of
    the resolution below the edge.
    """
    photon_kev = line.energy_kev - electron_kev
    edge = compton_edge_kev(line.energy_kev)
    cosine = max(_cosine(line.energy_kev, photon_kev), -1.0)
    blur = variance + doppler_kev(line.energy_kev, max(photon_kev, line.energy_kev - edge), cosine) ** 2
    likely_kev = max(photon_kev, line.energy_kev - edge + BELOW_EDGE * math.sqrt(blur))
    theta = math.acos(max(_cosine(line.energy_kev, likely_kev), -1.0))
    slope = ELECTRON_KEV / (likely_kev * likely_kev * max(math.sin(theta), 1e-3))
    tilt = (position_variance(electron_kev) + position_variance(photon_kev)) / (length_mm * length_mm)
    spread = min(blur * slope * slope + tilt, SIGMA_MAX_RAD * SIGMA_MAX_RAD)
    sigma = math.sqrt(spread + SIGMA_FLOOR_RAD * SIGMA_FLOOR_RAD)

    photo, total = attenuation_per_mm(photon_kev)
    recoil = klein_nishina_recoil(line.energy_kev, min(electron_kev, edge))
    beyond = (electron_kev - edge) / math.sqrt(2.0 * blur)
    reached = (1.0 - TAIL) * math.erfc(beyond) + TAIL * math.erfc(beyond / TAIL_WIDTH)
    return theta, sigma, recoil * photo * math.exp(-total * length_mm) * 0.5 * reached
