"""Photons in the CdTe sensor: analog Monte Carlo from the entry to absorption or escape.

Photoelectric absorption (Sauter's angular distribution, K fluorescence of Cd and Te, re-absorbed or not), Compton
scattering (Klein-Nishina times the incoherent scattering function; Doppler broadening by shell in the impulse
approximation, Ribberfors 1975), Rayleigh scattering with form factors; any number of scatters. Lengths in mm, energies in
keV, camera frame (z: the sensor's outward normal, sensor centred on the origin).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from radron.agent.detector.readout import PIXEL_PITCH_MM, SENSOR_PIXELS, SENSOR_THICKNESS_MM
from radron.sim.radiation._jit import jit
from radron.sim.radiation.electrons import rotated
from radron.sim.radiation.materials import ELECTRON_MASS_KEV, CdTe

FloatArray = NDArray[np.float64]

HALF_SIZE_MM = np.array([0.5 * SENSOR_PIXELS * PIXEL_PITCH_MM] * 2 + [0.5 * SENSOR_THICKNESS_MM])
MAX_SITES = 24
ABSORBED_BELOW_KEV = 5.0  # a photon of so little energy is absorbed within a few um
# columns of a site: x, y, z, deposited energy, kinetic energy of its electron, the electron's direction
SITE_COLUMNS = 8


def projected_area_mm2(direction: tuple[float, float, float]) -> float:
    """Return the area of the sensor's shadow along a unit vector, mm2."""
    hx, hy, hz = HALF_SIZE_MM
    return float(4.0 * (hy * hz * abs(direction[0]) + hx * hz * abs(direction[1]) + hx * hy * abs(direction[2])))


@jit
def interpolate(x: float, xs: FloatArray, ys: FloatArray) -> float:
    """Interpolate linearly in a table of rising xs; the result is constant beyond the table's ends."""
    if x <= xs[0]:
        return float(ys[0])
    if x >= xs[-1]:
        return float(ys[-1])
    cell = np.searchsorted(xs, x)
    part = (x - xs[cell - 1]) / (xs[cell] - xs[cell - 1])
    return float(ys[cell - 1] * (1.0 - part) + ys[cell] * part)


@jit
def enter(source: FloatArray, half: FloatArray, rng: np.random.Generator, position: FloatArray) -> None:
    """Draw a random point at which a parallel beam from the direction ``source`` meets the box, and write it to position (3,).

    half: (3,) half sizes of the box.
    """
    shadow_x = half[1] * half[2] * abs(source[0])
    shadow_y = half[0] * half[2] * abs(source[1])
    shadow_z = half[0] * half[1] * abs(source[2])
    pick = rng.random() * (shadow_x + shadow_y + shadow_z)
    face = 0 if pick < shadow_x else (1 if pick < shadow_x + shadow_y else 2)
    for axis in range(3):
        position[axis] = half[axis] * (2.0 * rng.random() - 1.0)
    position[face] = half[face] * np.sign(source[face])


@jit
def way_out(position: FloatArray, direction: FloatArray, half: FloatArray) -> float:
    """Return the distance from a point in the box to its surface along a unit vector."""
    distance = 1e9
    for axis in range(3):
        speed = direction[axis]
        if speed > 1e-12:
            distance = min(distance, (half[axis] - position[axis]) / speed)
        elif speed < -1e-12:
            distance = min(distance, (-half[axis] - position[axis]) / speed)
    return max(0.0, distance)


@jit
def scatter_compton(energy: float, element: int, cdte: CdTe, rng: np.random.Generator) -> tuple[float, float]:
    """Draw energy (keV) and cosine of the scattering angle of a Compton-scattered photon."""
    k = energy / ELECTRON_MASS_KEV
    least = 1.0 / (1.0 + 2.0 * k)  # E'/E at 180 degrees
    share = math.log(1.0 / least) / (math.log(1.0 / least) + 0.5 * (1.0 - least * least))
    inverse_wavelength = energy / 12.39842  # 1/angstrom
    cosine = 1.0
    while True:  # Kahn's mixture for Klein-Nishina, then the incoherent scattering function
        reciprocal = rng.random() < share
        u = rng.random()
        ratio = least**u if reciprocal else math.sqrt(least * least + (1.0 - least * least) * u)
        versine = (1.0 - ratio) / (k * ratio)
        if rng.random() > 1.0 - ratio * versine * (2.0 - versine) / (1.0 + ratio * ratio):
            continue
        cosine = 1.0 - versine
        transfer = inverse_wavelength * math.sqrt(max(0.0, 0.5 * versine))
        if rng.random() < interpolate(transfer, cdte.transfer, cdte.incoherent[element]):
            break
    quantiles = cdte.momentum.shape[2]
    for _ in range(100):  # an electron that can be freed, and its momentum along the transfer
        shell = np.searchsorted(cdte.shell_cumulative[element], rng.random())
        cell = rng.random() * (quantiles - 1)
        low = int(cell)
        p = cdte.momentum[element, shell, low] * (1.0 - (cell - low)) + cdte.momentum[element, shell, low + 1] * (cell - low)
        # p = (k' - k + k k' (1 - cos)) / |k - k'|, solved for k'
        a = 1.0 + k * (1.0 - cosine)
        quadratic = a * a - p * p
        linear = k * (a - p * p * cosine)
        root = linear * linear - quadratic * k * k * (1.0 - p * p)
        if root < 0.0 or quadratic <= 0.0:
            continue
        scattered = (linear + np.sign(p) * math.sqrt(root)) / quadratic * ELECTRON_MASS_KEV
        if 0.0 < scattered < energy - cdte.shell_edge_kev[element, shell]:
            return scattered, cosine
    return energy / (1.0 + k * (1.0 - cosine)), cosine


@jit
def scatter_rayleigh(energy: float, element: int, cdte: CdTe, rng: np.random.Generator) -> float:
    """Draw the cosine of the scattering angle of a coherently scattered photon."""
    largest = energy / 12.39842
    form = cdte.form_squared[element]
    whole = interpolate(largest, cdte.transfer, form)
    while True:
        wanted = rng.random() * whole
        cell = max(1, min(len(form) - 1, int(np.searchsorted(form, wanted))))
        low, high = cdte.transfer[cell - 1] ** 2, cdte.transfer[cell] ** 2
        square = low + (high - low) * (wanted - form[cell - 1]) / (form[cell] - form[cell - 1])
        cosine = max(-1.0, 1.0 - 2.0 * square / (largest * largest))
        if rng.random() < 0.5 * (1.0 + cosine * cosine):
            return float(cosine)


@jit
def photoelectron_cosine(kinetic: float, rng: np.random.Generator) -> float:
    """Draw the cosine of the angle between a photon and the electron that it freed from the K shell (Sauter's distribution)."""
    gamma = 1.0 + kinetic / ELECTRON_MASS_KEV
    beta = math.sqrt(1.0 - 1.0 / (gamma * gamma))
    a = 1.0 / beta - 1.0
    b = 0.5 * beta * gamma * (gamma - 1.0) * (gamma - 2.0)
    top = 2.0 * (1.0 / a + b)
    while True:
        random = rng.random()
        versine = 2.0 * a / ((a + 2.0) ** 2 - 4.0 * random) * (2.0 * random + (a + 2.0) * math.sqrt(random))
        if rng.random() * top < (2.0 - versine) * (1.0 / (a + versine) + b):
            return float(1.0 - versine)


@jit
def attenuation_per_mm(energy_kev: float, cdte: CdTe) -> float:
    """Return the linear attenuation coefficient of CdTe at an energy, interpolated, per mm."""
    start = cdte.log_energy[0]
    place = (math.log(energy_kev) - start) * (len(cdte.log_energy) - 1) / (cdte.log_energy[-1] - start)
    cell = max(0, min(len(cdte.log_energy) - 2, int(place)))
    return float(cdte.attenuation[cell] * (1.0 - (place - cell)) + cdte.attenuation[cell + 1] * (place - cell))


@jit
def transport(
    energy_kev: float,
    flight_mm: float,
    position: FloatArray,
    direction: FloatArray,
    half: FloatArray,
    cdte: CdTe,
    rng: np.random.Generator,
    sites: FloatArray,
    stack: FloatArray,
) -> int:
    """Simulate a photon in the sensor until it is absorbed or escapes; return the number of its deposits of energy.

    Args:
        energy_kev: energy of the photon.
        flight_mm: distance to its first interaction.
        position, direction: (3,) begin of its path; both are overwritten.
        half: (3,) half sizes of the sensor.
        cdte: cross sections.
        rng: random numbers.
        sites: (MAX_SITES, SITE_COLUMNS) gets the deposits, in the order in which the photon made them.
        stack: (MAX_SITES + 1, 7) work space.
    """
    for axis in range(3):
        stack[0, axis] = position[axis]
        stack[0, 3 + axis] = direction[axis]
    stack[0, 6] = energy_kev
    waiting = 1
    count = 0
    start = cdte.log_energy[0]
    scale = (len(cdte.log_energy) - 1) / (cdte.log_energy[-1] - start)
    while waiting > 0 and count < MAX_SITES:
        waiting -= 1
        for axis in range(3):
            position[axis] = stack[waiting, axis]
            direction[axis] = stack[waiting, 3 + axis]
        energy = stack[waiting, 6]
        while count < MAX_SITES:
            cell = max(0, min(len(cdte.log_energy) - 2, int((math.log(energy) - start) * scale)))
            distance = flight_mm
            if distance < 0.0:
                distance = -math.log(1.0 - rng.random()) / attenuation_per_mm(energy, cdte)
            flight_mm = -1.0
            if distance >= way_out(position, direction, half):
                break
            for axis in range(3):
                position[axis] += distance * direction[axis]
            process = rng.random()
            if process < cdte.photo[cell]:
                waiting, count = _absorb(energy, cell, position, direction, cdte, rng, sites, count, stack, waiting)
                break
            if process < cdte.photo[cell] + cdte.compton[cell]:
                element = 1 if rng.random() < cdte.compton_te[cell] else 0
                scattered, cosine = scatter_compton(energy, element, cdte, rng)
                azimuth = 2.0 * np.pi * rng.random()
                u, v, w = rotated(direction[0], direction[1], direction[2], cosine, azimuth)
                _place(sites, count, position, energy - scattered, energy - scattered)
                norm = math.sqrt(energy * energy + scattered * scattered - 2.0 * energy * scattered * cosine)
                sites[count, 5] = (energy * direction[0] - scattered * u) / norm
                sites[count, 6] = (energy * direction[1] - scattered * v) / norm
                sites[count, 7] = (energy * direction[2] - scattered * w) / norm
                count += 1
                energy = scattered
                if energy < ABSORBED_BELOW_KEV:
                    sites[count - 1, 3] += energy
                    break
            else:
                element = 1 if rng.random() < cdte.rayleigh_te[cell] else 0
                cosine = scatter_rayleigh(energy, element, cdte, rng)
                u, v, w = rotated(direction[0], direction[1], direction[2], cosine, 2.0 * np.pi * rng.random())
            direction[0], direction[1], direction[2] = u, v, w
    return count


@jit
def _place(sites: FloatArray, count: int, position: FloatArray, deposit: float, kinetic: float) -> None:
    for axis in range(3):
        sites[count, axis] = position[axis]
    sites[count, 3] = deposit
    sites[count, 4] = kinetic


@jit
def _absorb(
    energy: float,
    cell: int,
    position: FloatArray,
    direction: FloatArray,
    cdte: CdTe,
    rng: np.random.Generator,
    sites: FloatArray,
    count: int,
    stack: FloatArray,
    waiting: int,
) -> tuple[int, int]:
    """Photoelectric absorption: a site with its photoelectron, and perhaps a fluorescence photon onto the stack."""
    element = 1 if rng.random() < cdte.photo_te[cell] else 0
    edge = cdte.k_edge_kev[element]
    deposit = energy
    kinetic = energy
    if energy > edge and rng.random() < cdte.k_share[element, cell + 1]:
        kinetic = energy - edge
        if rng.random() < cdte.k_yield[element] and waiting < MAX_SITES:
            line = np.searchsorted(cdte.k_line_cumulative[element], rng.random())
            line_kev = cdte.k_line_kev[element, min(line, cdte.k_line_kev.shape[1] - 1)]
            deposit -= line_kev
            cosine = 2.0 * rng.random() - 1.0
            sine = math.sqrt(1.0 - cosine * cosine)
            azimuth = 2.0 * np.pi * rng.random()
            for axis in range(3):
                stack[waiting, axis] = position[axis]
            stack[waiting, 3] = sine * math.cos(azimuth)
            stack[waiting, 4] = sine * math.sin(azimuth)
            stack[waiting, 5] = cosine
            stack[waiting, 6] = line_kev
            waiting += 1
    _place(sites, count, position, deposit, kinetic)
    u, v, w = rotated(
        direction[0], direction[1], direction[2], photoelectron_cosine(max(kinetic, 0.1), rng), 2.0 * np.pi * rng.random()
    )
    sites[count, 5], sites[count, 6], sites[count, 7] = u, v, w
    return waiting, count + 1
