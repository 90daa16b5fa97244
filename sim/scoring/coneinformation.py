"""Fisher information of a Compton cone about the angle between its axis and the source, its order being ambiguous.

Reading o of a cone has the axis a (from absorption to recoil; the other reading has -a), the opening angle theta_o, the error
sigma_o and the probability p_o. With alpha the angle between a and the source, alpha_1 = alpha, alpha_2 = pi - alpha, the density
of the cone per solid angle is

    f(alpha) = sum_o p_o sum_j s_j N(alpha_o - theta_o; 0, (c_j sigma_o)^2),   each reading normalised over the sphere,

s = ``SHARES``, c = ``WIDTHS``. A share eps of all cones is isotropic, of density U = 1 / (4 pi). The information of one cone is

    i(eps) = integral over the sphere of g'^2 / g,   g = (1 - eps) f + eps U
           = integral of f'^2 / (f / (1 - eps) + eps U / (1 - eps)^2),

averaged over simulated coincidences. Energies, errors and probabilities of the readings follow the project's estimation reference
("Detector", "Beyond"); cross sections are xraylib's.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import xraylib

from radron.sim.geometry import Array
from radron.sim.radiation.events import CLUSTER_KEV
from radron.sim.radiation.materials import CDTE_DENSITY_GCM3, ELECTRON_MASS_KEV, ELEMENTS
from radron.sim.radiation.transport import HALF_SIZE_MM

SHARES = (0.77, 0.23)  # weights s_j of the two Gaussians; below, their widths c_j in units of a reading's sigma
WIDTHS = (0.9, 2.8)
_TRUST = (0.08, 0.84)  # probability of an order from its share w of the weights: the raw share is overconfident
_MAX_RAD, _MIN_RAD = 0.35, 0.02  # sigma is cut off, and has a floor
_LATERAL_MM, _DEPTH_MM = 0.04, 0.075  # of a cluster's place
_DOPPLER_KEV, _EDGE_KEV2 = 6.0, 64.0
_SEPARATION_MM = 0.2  # nearer clusters are one
_XRAYLIB_KEV = 799.0  # its tables end
_CANDIDATES = 4000
_ANGLES = 720


def cone_information(line_kev: float, astray: Sequence[float], cones: int = 300) -> Array:
    """Return the mean Fisher information (rad^-2) of a Compton cone about the angle between its axis and the source.

    astray: (S,) shares of cones that do not point to the source; the result is (S,), one value for each. cones: number of
    simulated coincidences (pairs of clusters from one photon) in the mean.
    """
    electron_kev, separation_mm, depth = _coincidences(line_kev, cones)
    energies = np.stack((electron_kev, line_kev - electron_kev), axis=1)  # (C, 2): the electron's in each reading
    theta, sigma, weight = _readings(line_kev, energies, separation_mm[:, None], depth[:, None])
    share = weight / weight.sum(axis=1, keepdims=True)
    probability = np.where(np.minimum(share, 1.0 - share) > 0.0, _TRUST[0] + _TRUST[1] * share, share)  # (C, 2)
    edges = np.linspace(0.0, np.pi, _ANGLES + 1)
    angle = (edges[1:] + edges[:-1]) / 2.0  # (A,) between the axis of the first reading and the source
    solid = np.sin(angle)
    apart = np.stack((angle, np.pi - angle))[None] - theta[..., None]  # (C, 2, A): angular errors of the readings
    density = np.zeros((len(theta), len(angle)))
    slope = np.zeros_like(density)
    for reading, turn in ((0, 1.0), (1, -1.0)):
        delta = apart[:, reading]
        value, derivative = np.zeros_like(delta), np.zeros_like(delta)
        for portion, width in zip(SHARES, WIDTHS, strict=True):
            variance = (width * sigma[:, reading, None]) ** 2
            part = portion * np.exp(-0.5 * delta**2 / variance) / np.sqrt(variance)
            value += part
            derivative -= turn * part * delta / variance
        scale = probability[:, reading, None] / np.sum(value * solid, axis=1, keepdims=True)
        density += scale * value
        slope += scale * derivative
    nowhere = 1.0 / solid.sum()
    square = slope**2 * solid / len(theta)
    return np.array([np.sum(square / (density / (1.0 - lost) + lost / (1.0 - lost) ** 2 * nowhere)) for lost in astray])


def _coincidences(line_kev: float, count: int) -> tuple[Array, Array, Array]:
    """(C,) recoil energy in keV, distance in mm and its component along the sensor's normal, as a share of it.

    One Compton scatter (Klein-Nishina) anywhere in the sensor, into any direction of the sensor, then photoelectric absorption.
    """
    rng = np.random.default_rng(0)
    alpha = line_kev / ELECTRON_MASS_KEV
    cosine = rng.uniform(-1.0, 1.0, _CANDIDATES)
    photon_kev = line_kev / (1.0 + alpha * (1.0 - cosine))
    ratio = photon_kev / line_kev
    scatter = ratio**2 * (ratio + 1.0 / ratio - 1.0 + cosine**2)
    photo, total = _attenuation_per_mm(photon_kev)
    place = rng.uniform(-1.0, 1.0, (_CANDIDATES, 3)) * HALF_SIZE_MM
    direction = rng.standard_normal((_CANDIDATES, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    separation_mm = -np.log(rng.uniform(size=_CANDIDATES)) / total
    inside = np.all(np.abs(place + separation_mm[:, None] * direction) < HALF_SIZE_MM, axis=1)
    seen = inside & (separation_mm > _SEPARATION_MM) & (line_kev - photon_kev > CLUSTER_KEV)
    weight = np.where(seen, scatter * photo / total, 0.0)
    chosen = rng.choice(_CANDIDATES, count, p=weight / weight.sum())
    return (line_kev - photon_kev)[chosen], separation_mm[chosen], direction[chosen, 2]


def _readings(line_kev: float, electron_kev: Array, separation_mm: Array, depth: Array) -> tuple[Array, Array, Array]:
    """theta, sigma (rad) and unnormalised weight of readings with these recoil energies E_e; all arrays of one shape.

    E the line's energy, E' = E - E_e, alpha = E / 511 keV: cos(theta) = 1 + 511 (1 / E - 1 / E') (the paper's eq. (3)); weight =
    Klein-Nishina dsigma/dE_e times the photoelectric absorption after the separation, mu_pe exp(-mu L), with a soft cut-off above
    the Compton edge.
    """
    alpha = line_kev / ELECTRON_MASS_KEV
    edge = line_kev * 2.0 * alpha / (1.0 + 2.0 * alpha)
    photon_kev = line_kev - electron_kev
    theta = np.arccos(np.clip(1.0 + ELECTRON_MASS_KEV * (1.0 / line_kev - 1.0 / photon_kev), -1.0, 1.0))
    sine = np.maximum(np.sin(theta), 0.05)
    variances = (2.5**2 + (0.02 * electron_kev) ** 2, 2.5**2 + (0.02 * photon_kev) ** 2)
    variance = variances[0] * variances[1] / (variances[0] + variances[1])
    blur = (variance + _DOPPLER_KEV**2) * (ELECTRON_MASS_KEV / (photon_kev**2 * sine)) ** 2
    tilt = (2.0 * _DEPTH_MM**2 * (1.0 - depth**2) + 2.0 * _LATERAL_MM**2) / separation_mm**2
    sigma = np.sqrt(np.minimum(blur + tilt, _MAX_RAD**2) + _MIN_RAD**2)
    s = np.minimum(electron_kev, edge) / line_kev
    q = s / (1.0 - s)
    recoil = 2.0 + (q / alpha) ** 2 + q * (s - 2.0 / alpha)
    beyond = np.exp(-0.5 * np.maximum(electron_kev - edge, 0.0) ** 2 / (variance + _EDGE_KEV2))
    photo, total = _attenuation_per_mm(photon_kev)
    return theta, sigma, recoil * beyond * photo * np.exp(-total * separation_mm)


def _attenuation_per_mm(energy_kev: Array) -> tuple[Array, Array]:
    """Return the photoelectric and total attenuation coefficients of CdTe, per mm."""
    log = np.log(np.clip(energy_kev, 5.0, _XRAYLIB_KEV))
    grid, logs = _attenuation_table()
    photo, total = (np.exp(np.interp(log, grid, of)) for of in logs)
    return photo, total


@cache
def _attenuation_table() -> tuple[Array, Array]:
    """(G,) logarithms of the energy, (2, G) of the photoelectric and the total coefficient per mm."""
    grid = np.geomspace(5.0, _XRAYLIB_KEV, 200)
    mass = np.array([xraylib.AtomicWeight(element) for element in ELEMENTS])
    share = mass / mass.sum()
    tables = [
        [sum(w * of(element, energy) for w, element in zip(share, ELEMENTS, strict=True)) for energy in grid.tolist()]
        for of in (xraylib.CS_Photo, xraylib.CS_Total)
    ]
    return np.log(grid), np.log(CDTE_DENSITY_GCM3 / 10.0 * np.array(tables))
