"""Tracks of recoil electrons and photoelectrons in CdTe: slowing down and multiple scattering, step by step.

Stopping power: Bethe's formula for electrons (ICRU 37) with the mean excitation energy of CdTe, 539.3 eV, and Joy and Luo's
(1989) correction below a few keV; radiative losses (1-2 % below 500 keV), straggling and delta rays are left out.
Deflection: the transport mean free path of the screened Rutherford cross section with Moliere's screening angle; a step of
length s deflects by an angle whose mean cosine is exp(-s / path).
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from radron.sim.radiation._jit import jit
from radron.sim.radiation.materials import CDTE_DENSITY_GCM3, ELECTRON_MASS_KEV

MAX_STEPS = 400
_MEAN_EXCITATION_KEV = 0.5393
_MOLAR_MASS = 112.41 + 127.6
_ELECTRONS = 48 + 52
_BETHE_KEV_CM2 = 153.5374  # 2 pi r_e^2 m c^2 N_A, per mol
_RADIUS2_AVOGADRO_CM2 = 7.940788e-26 * 6.02214076e23  # r_e^2 N_A, per mol
_STOPPED_KEV = 20.0  # a range of 3 um: the rest is deposited on the spot
_MAX_STEP_MM = 0.015

FloatArray = NDArray[np.float64]


class Electrons(NamedTuple):
    """Tables for the slowing down of electrons in CdTe, with G energies.

    log_energy: (G,) natural logarithm of keV. stopping: (G,) stopping power, keV/mm. deflection: (G,) inverse transport mean free
    path, 1/mm.
    """

    log_energy: FloatArray
    stopping: FloatArray
    deflection: FloatArray


@cache
def electrons(grid: int = 400) -> Electrons:
    """Return the tables for electrons in CdTe from 1 keV to 1.6 MeV."""
    log_energy = np.linspace(0.0, np.log(1600.0), grid)
    energy = np.exp(log_energy)
    tau = energy / ELECTRON_MASS_KEV
    gamma = 1.0 + tau
    beta2 = 1.0 - 1.0 / gamma**2

    excitation = _MEAN_EXCITATION_KEV / (1.0 + 0.85 * _MEAN_EXCITATION_KEV / energy)  # Joy and Luo
    bracket = (
        np.log(tau**2 * (tau + 2.0) / (2.0 * (excitation / ELECTRON_MASS_KEV) ** 2))
        + 1.0
        - beta2
        + (tau**2 / 8.0 - (2.0 * tau + 1.0) * np.log(2.0)) / gamma**2
    )
    stopping = CDTE_DENSITY_GCM3 * _BETHE_KEV_CM2 * _ELECTRONS / _MOLAR_MASS / beta2 * bracket / 10.0

    deflection = np.zeros_like(energy)
    momentum = np.sqrt(tau * (tau + 2.0))  # units of m c
    for charge in (48, 52):
        alpha_z = charge / 137.035999
        screening = (charge ** (1.0 / 3.0) / (137.035999 * 0.885 * momentum)) ** 2 / 4.0 * (1.13 + 3.76 * alpha_z**2 / beta2)
        cross = 2.0 * np.pi * charge * (charge + 1.0) / (momentum**2 * beta2)
        cross *= np.log1p(1.0 / screening) - 1.0 / (1.0 + screening)
        deflection += CDTE_DENSITY_GCM3 / _MOLAR_MASS * _RADIUS2_AVOGADRO_CM2 * cross / 10.0
    return Electrons(log_energy, stopping, deflection)


def csda_range_mm(energy_kev: float) -> float:
    """Return the length of the track of an electron that slows down continuously to 1 keV, mm."""
    tables = electrons()
    grid = np.exp(tables.log_energy)
    energy = np.append(grid[grid < energy_kev], energy_kev)
    return float(np.trapezoid(1.0 / np.interp(np.log(energy), tables.log_energy, tables.stopping), energy))


@jit
def rotated(u: float, v: float, w: float, cosine: float, azimuth: float) -> tuple[float, float, float]:
    """Return the unit vector (u, v, w) after a deflection by an angle.

    cosine: of the angle. azimuth: direction of the deflection about the vector, radians.
    """
    sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
    a, b = sine * math.cos(azimuth), sine * math.sin(azimuth)
    rho = math.sqrt(u * u + v * v)
    if rho < 1e-9:
        return a, b * np.sign(w), cosine * np.sign(w)
    return (
        u * cosine + (u * w * a - v * b) / rho,
        v * cosine + (v * w * a + u * b) / rho,
        w * cosine - a * rho,
    )


@jit
def track(
    position: FloatArray,
    direction: FloatArray,
    energy_kev: float,
    half_size: FloatArray,
    tables: Electrons,
    rng: np.random.Generator,
    points: FloatArray,
) -> int:
    """Simulate the track of an electron until it stops or leaves the box of +- half_size mm; return the number of its deposits.

    Each deposit is written into points (MAX_STEPS, 4): x, y, z in mm, and energy in keV.
    """
    x, y, z = position[0], position[1], position[2]
    u, v, w = direction[0], direction[1], direction[2]
    start = tables.log_energy[0]
    scale = (len(tables.log_energy) - 1) / (tables.log_energy[-1] - start)
    count = 0
    while energy_kev > _STOPPED_KEV and count < MAX_STEPS - 1:
        cell = int((math.log(energy_kev) - start) * scale)
        stopping = tables.stopping[cell]
        deflection = tables.deflection[cell]
        step = min(_MAX_STEP_MM, 1.0 / deflection, 0.2 * energy_kev / stopping)
        loss = step * stopping
        x += 0.5 * step * u
        y += 0.5 * step * v
        z += 0.5 * step * w
        if abs(x) > half_size[0] or abs(y) > half_size[1] or abs(z) > half_size[2]:
            return count
        points[count, 0], points[count, 1], points[count, 2], points[count, 3] = x, y, z, loss
        count += 1
        energy_kev -= loss
        x += 0.5 * step * u
        y += 0.5 * step * v
        z += 0.5 * step * w
        # The cosine is drawn from a density exp(a cosine); its mean is coth(a) - 1/a, and a is fitted to exp(-step deflection).
        mean = math.exp(-step * deflection)
        a = mean * (3.0 - mean * mean) / (1.0 - mean * mean)
        cosine = max(-1.0, 1.0 + math.log(1.0 - rng.random() * (1.0 - math.exp(-2.0 * a))) / a)
        u, v, w = rotated(u, v, w, cosine, 2.0 * np.pi * rng.random())
    if abs(x) <= half_size[0] and abs(y) <= half_size[1] and abs(z) <= half_size[2]:
        points[count, 0], points[count, 1], points[count, 2], points[count, 3] = x, y, z, energy_kev
        count += 1
    return count
