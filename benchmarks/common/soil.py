"""Photons that soil and air scatter to a point: the agent's model, computed by another method than the simulation's truth.

The truth (``radron.sim.radiation.ground``) follows each photon analogously and counts crossings of levels. Here photons lose
weight instead of being absorbed, all of a batch at once. Each scattering adds the expected direct flux to each detector, by the
differential cross section of Klein and Nishina (next-event estimation), by the angle of incidence on sensors of several headings.
Compton scattering off free electrons and photoelectric absorption (xraylib); soil is silica with 20 % of water and 4 % of iron.
No coherent scattering.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import xraylib

from radron.agent.geometry import Array

MASS_KEV = 510.99895
_BARN_RADIUS = 7.940787e-26  # square of the classical electron radius, cm2
_AVOGADRO = 6.02214076e23
_AIR = ((7, 0.7552), (8, 0.2314), (18, 0.0134))
_SOIL = ((1, 0.0224), (8, 0.604), (14, 0.3336), (26, 0.04))
_ASPHALT = ((1, 0.0086), (6, 0.0514), (8, 0.501), (14, 0.439))  # silica with 6 % of bitumen
_CONCRETE = ((1, 0.01), (8, 0.53), (13, 0.034), (14, 0.337), (19, 0.013), (20, 0.05), (26, 0.014))
DENSITY = (1.205e-3, 1.5)  # air, soil, g/cm3
GROUNDS = {
    "soil": (_SOIL, DENSITY[1]),
    "sand": (((8, 0.533), (14, 0.467)), 1.6),
    "asphalt": (_ASPHALT, 2.3),
    "concrete": (_CONCRETE, 2.3),
    "water": (((1, 0.1119), (8, 0.8881)), 1.0),
}  # elements with their mass fractions, and density
GRID_KEV = np.geomspace(15.0, 3000.0, 430)
MIN_KEV = 30.0
_CEILING_M = 250.0
MIN_WEIGHT = 1e-3
_MIN_APART_M = 0.7  # a scattering nearer to a detector counts as from there: 0.4 % less flux, and no outliers
GENERATIONS = 60
HEADINGS_DEG = (0.0, 30.0, 60.0, 90.0)  # of a level sensor's normal, from the direction to the source
FACINGS = 8  # bins of the cosine between a photon's path and the normal


@cache
def attenuations(ground: str = "soil") -> tuple[Array, Array]:
    """(2, GRID) attenuation per metre of air and the ground, and the share of Compton scattering."""
    totals, shares = [], []
    for elements, density in ((_AIR, DENSITY[0]), GROUNDS[ground]):
        electrons = sum(share * z / xraylib.AtomicWeight(z) for z, share in elements) * _AVOGADRO
        compton = electrons * _BARN_RADIUS * np.array([_klein_nishina_total(float(e)) for e in GRID_KEV])
        photo = np.zeros_like(compton)
        for z, share in elements:
            photo += share * np.array([_photo(z, float(e)) for e in GRID_KEV])
        totals.append(100.0 * density * (compton + photo))
        shares.append(compton / (compton + photo))
    return np.array(totals), np.array(shares)


def _photo(z: int, energy_kev: float) -> float:
    if energy_kev <= 799.0:
        return float(xraylib.CS_Photo(z, energy_kev))
    return float(xraylib.CS_Photo(z, 799.0)) * (799.0 / energy_kev) ** 2.5


def _klein_nishina_total(energy_kev: float) -> float:
    """In squares of the classical electron radius."""
    k = energy_kev / MASS_KEV
    log = np.log1p(2.0 * k)
    first = (1.0 + k) / k**2 * (2.0 * (1.0 + k) / (1.0 + 2.0 * k) - log / k)
    return float(2.0 * np.pi * (first + log / (2.0 * k) - (1.0 + 3.0 * k) / (1.0 + 2.0 * k) ** 2))


def klein_nishina(energy: Array, cosine: Array) -> tuple[Array, Array]:
    """Density per steradian of the direction after a scattering (relative to all), and the energy there."""
    ratio = 1.0 / (1.0 + energy / MASS_KEV * (1.0 - cosine))
    total = np.interp(energy, GRID_KEV, _totals())
    return 0.5 * ratio**2 * (ratio + 1.0 / ratio - 1.0 + cosine**2) / total, energy * ratio


@cache
def _totals() -> Array:
    return np.array([_klein_nishina_total(float(e)) for e in GRID_KEV])


def scattering_cosines(energy: Array, rng: np.random.Generator) -> Array:
    """Cosines of scattering angles, by inversion of their tabulated distribution."""
    cosine = np.linspace(-1.0, 1.0, 201)
    result = np.empty_like(energy)
    order = np.argsort(energy)
    for some in np.array_split(order, max(1, len(order) // 400)):  # of nearly the same energy
        density, _ = klein_nishina(np.full(201, energy[some].mean()), cosine)
        cumulative = np.concatenate(([0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))))
        result[some] = np.interp(rng.random(len(some)) * cumulative[-1], cumulative, cosine)
    return result


def scattered_flux(
    lines: tuple[tuple[float, float], ...],
    detectors: Array,
    edges_kev: Array,
    photons: int,
    seed: int,
    source_m: float = 0.0,
    ground: str = "soil",
) -> Array:
    """(D, HEADINGS_DEG, FACINGS, groups) flux per decay times 4 pi D^2 of scattered photons; its sum over FACINGS is the same for
    all headings. detectors: (D, 2) heights above soil, horizontal distances.

    source_m: height of the source above the ground; below 0: in it. ground: of ``GROUNDS``.
    """
    rng = np.random.default_rng(seed)
    energies, intensities = np.array(lines).T
    tally = np.zeros((len(detectors), len(HEADINGS_DEG), FACINGS, len(edges_kev) - 1))
    batch = 10_000
    for _ in range(photons // batch):
        tally += _batch(
            energies, intensities / intensities.sum(), detectors, edges_kev, batch, rng, source_m, attenuations(ground)
        )
    square = (detectors[:, 0] - source_m) ** 2 + detectors[:, 1] ** 2
    result: Array = tally * (intensities.sum() / (photons // batch * batch)) * 4.0 * np.pi * square[:, None, None, None]
    return result


def _batch(
    energies: Array,
    shares: Array,
    detectors: Array,
    edges_kev: Array,
    count: int,
    rng: np.random.Generator,
    source_m: float,
    attenuated: tuple[Array, Array],
) -> Array:
    media, compton = attenuated
    tally = np.zeros((len(detectors), len(HEADINGS_DEG), FACINGS, len(edges_kev) - 1))
    energy = rng.choice(energies, count, p=shares)
    place = np.zeros((count, 3))
    place[:, 2] = source_m
    direction = isotropic(count, rng)
    weight = np.ones(count)
    for _ in range(GENERATIONS):
        place, soil, out = moved(place, direction, energy, media, rng)
        kept, weight = survivors(unabsorbed(weight, energy, soil, compton), energy, out, rng)
        place, direction, energy, weight = place[kept], direction[kept], energy[kept], weight[kept]
        if not len(energy):
            break
        tally += _seen(place, direction, energy, weight, detectors, edges_kev, media, rng)
        cosine = scattering_cosines(energy, rng)
        direction = deflected(direction, cosine, rng)
        energy = energy / (1.0 + energy / MASS_KEV * (1.0 - cosine))
    return tally


def unabsorbed(weight: Array, energy: Array, soil: Array, compton: Array) -> Array:
    """Weights after interactions in soil or air: less the share that is absorbed."""
    share: Array = np.where(soil, np.interp(energy, GRID_KEV, compton[1]), np.interp(energy, GRID_KEV, compton[0]))
    return weight * share


def survivors(weight: Array, energy: Array, out: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Photons to be followed further, and all weights: a tenth of the light photons survives, with ten times the weight."""
    kept = ~out & (energy > MIN_KEV)
    kept &= (weight > MIN_WEIGHT) | (rng.random(len(weight)) < 0.1)
    return kept, np.where(weight > MIN_WEIGHT, weight, 10.0 * weight)


def isotropic(count: int, rng: np.random.Generator) -> Array:
    w, azimuth = rng.uniform(-1.0, 1.0, count), rng.uniform(0.0, 2.0 * np.pi, count)
    flat = np.sqrt(1.0 - w * w)
    return np.column_stack((flat * np.cos(azimuth), flat * np.sin(azimuth), w))


def moved(place: Array, direction: Array, energy: Array, media: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Places of the next interactions, whether in soil, and whether so far away that they do not count."""
    air, soil = (np.interp(energy, GRID_KEV, one) for one in media)
    z, w = place[:, 2], direction[:, 2]
    depth = rng.exponential(size=len(energy))
    inside = (z < 0.0) | ((z == 0.0) & (w < 0.0))
    here, there = np.where(inside, soil, air), np.where(inside, air, soil)
    leaves = (inside & (w > 0.0)) | (~inside & (w < 0.0))
    to_border = np.where(leaves, -z / np.where(w == 0.0, 1e-12, w), np.inf)
    crosses = depth > to_border * here
    rest = np.where(crosses, depth - np.where(crosses, to_border, 0.0) * here, 0.0)
    way = np.where(crosses, np.where(crosses, to_border, 0.0) + rest / there, depth / here)
    place = place + way[:, None] * direction
    return place, place[:, 2] < 0.0, np.abs(place[:, 2]) > _CEILING_M


def _seen(
    place: Array,
    direction: Array,
    energy: Array,
    weight: Array,
    detectors: Array,
    edges_kev: Array,
    media: Array,
    rng: np.random.Generator,
) -> Array:
    """Contribution to the tally of scatterings at these places; the detectors stand at a random azimuth."""
    azimuth = rng.uniform(0.0, 2.0 * np.pi, len(energy))
    height, horizontal = detectors.T
    dx = horizontal * np.cos(azimuth)[:, None] - place[:, :1]
    dy = horizontal * np.sin(azimuth)[:, None] - place[:, 1:2]
    dz = height - place[:, 2:3]
    apart = np.maximum(np.sqrt(dx * dx + dy * dy + dz * dz), _MIN_APART_M)
    cosine = np.clip((dx * direction[:, :1] + dy * direction[:, 1:2] + dz * direction[:, 2:3]) / apart, -1.0, 1.0)
    density, after = klein_nishina(np.broadcast_to(energy[:, None], cosine.shape), cosine)
    air, soil = (np.interp(after, GRID_KEV, one) for one in media)
    in_soil = apart * np.clip(-place[:, 2:3] / np.maximum(dz, 1e-9), 0.0, 1.0)
    value = weight[:, None] * density * np.exp(-soil * in_soil - air * (apart - in_soil)) / apart**2
    groups = len(edges_kev) - 1
    group = np.searchsorted(edges_kev, after) - 1
    inside = (group >= 0) & (group < groups)
    shape = len(detectors), FACINGS, groups
    by_heading = []
    for heading in np.deg2rad(HEADINGS_DEG):
        normal = np.cos(azimuth + heading)[:, None], np.sin(azimuth + heading)[:, None]
        facing = np.abs(dx * normal[0] + dy * normal[1]) / np.sqrt(dx * dx + dy * dy + dz * dz)
        place_of = (
            np.arange(len(detectors)),
            np.minimum((facing * FACINGS).astype(np.intp), FACINGS - 1),
            np.clip(group, 0, groups - 1),
        )
        index = np.ravel_multi_index(np.broadcast_arrays(*place_of), shape)
        by_heading.append(np.bincount(index[inside], value[inside], math.prod(shape)).reshape(shape))
    return np.stack(by_heading, axis=1)


def deflected(direction: Array, cosine: Array, rng: np.random.Generator) -> Array:
    """Directions after turning by these angles about random azimuths."""
    other = np.where(np.abs(direction[:, 2:3]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(direction, other)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(direction, first)
    azimuth, sine = rng.uniform(0.0, 2.0 * np.pi, len(cosine)), np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0))
    turned = cosine[:, None] * direction + (sine * np.cos(azimuth))[:, None] * first + (sine * np.sin(azimuth))[:, None] * second
    return turned / np.linalg.norm(turned, axis=1, keepdims=True)
