"""Photons of the soil's own radioactivity above it: the agent's model, computed by another method than the simulation's truth.

The truth (``radron.sim.radiation.ground``) follows each photon analogously and counts crossings of levels. Here depths of
emission are drawn by importance, photons lose weight instead of being absorbed, and each flight adds its expected unscattered
crossings to each height. Media and scattering come from ``soil``; the lines of the series from the caller.
"""

from __future__ import annotations

import numpy as np

from common.soil import (
    DENSITY,
    GENERATIONS,
    GRID_KEV,
    MASS_KEV,
    attenuations,
    deflected,
    isotropic,
    klein_nishina,
    moved,
    scattering_cosines,
    survivors,
    unabsorbed,
)
from radron.agent.geometry import Array

_NATURAL_DEPTH_M, _MEAN_DEPTH_M = 1.0, 0.3  # of the soil's own photons: the deepest emission, and the scale of the drawn depths
_MIN_COSINE = 0.01  # flatter photons count with their mean: no outliers
_KERMA_ANGLES = 2001
_JOULE_PER_KEV = 1.602177e-16


def natural_flux(lines: tuple[tuple[float, float], ...], heights_m: Array, edges_kev: Array, photons: int, seed: int) -> Array:
    """(H, groups) flux per m2 and s at heights above soil that emits these photons, evenly at all depths, in each kg and s.

    Over an infinite plane: each emission and each scattering adds its unscattered crossings to each height, over the cosine of
    the direction to the vertical.
    """
    rng = np.random.default_rng(seed)
    energies, intensities = np.array(lines).T
    tally = np.zeros((len(heights_m), len(edges_kev) - 1))
    batch = 10_000
    for _ in range(photons // batch):
        tally += _batch(energies, intensities / intensities.sum(), heights_m, edges_kev, batch, rng)
    per_m2 = intensities.sum() * 1e3 * DENSITY[1] * _NATURAL_DEPTH_M
    result: Array = tally * per_m2 / (photons // batch * batch)
    return result


def air_kerma(edges_kev: Array, flux: Array) -> float:
    """Air kerma rate (Gy/s) of a flux (groups,) per m2 and s: the energy that photons transfer to electrons."""
    energy = np.sqrt(edges_kev[1:] * edges_kev[:-1])
    cosine = np.linspace(-1.0, 1.0, _KERMA_ANGLES)
    density, after = klein_nishina(energy[:, None] * np.ones_like(cosine), cosine)
    given = 1.0 - np.trapezoid(density * after, cosine, axis=1) / np.trapezoid(density, cosine, axis=1) / energy
    media, compton = attenuations()
    attenuation, share = (np.interp(energy, GRID_KEV, table) for table in (media[0], compton[0]))
    per_kg = attenuation / (1e3 * DENSITY[0]) * (1.0 - share + share * given)  # m2/kg
    return float((flux * energy * per_kg).sum() * _JOULE_PER_KEV)


def _batch(energies: Array, shares: Array, heights_m: Array, edges_kev: Array, count: int, rng: np.random.Generator) -> Array:
    media, compton = attenuations()
    groups = len(edges_kev) - 1
    tally = np.zeros(len(heights_m) * groups)
    energy = rng.choice(energies, count, p=shares)
    whole = 1.0 - np.exp(-_NATURAL_DEPTH_M / _MEAN_DEPTH_M)
    depth = -_MEAN_DEPTH_M * np.log(1.0 - whole * rng.random(count))
    weight = _MEAN_DEPTH_M * whole * np.exp(depth / _MEAN_DEPTH_M) / _NATURAL_DEPTH_M
    place = np.zeros((count, 3))
    place[:, 2] = -depth
    direction = isotropic(count, rng)
    for _ in range(GENERATIONS):
        tally += _crossing(place[:, 2], direction[:, 2], energy, weight, heights_m, edges_kev, media)
        place, soil, out = moved(place, direction, energy, media, rng)
        weight = unabsorbed(weight, energy, soil, compton)
        cosine = scattering_cosines(energy, rng)
        direction = deflected(direction, cosine, rng)
        energy = energy / (1.0 + energy / MASS_KEV * (1.0 - cosine))
        kept, weight = survivors(weight, energy, out, rng)
        place, direction, energy, weight = place[kept], direction[kept], energy[kept], weight[kept]
        if not len(energy):
            break
    return tally.reshape(len(heights_m), groups)


def _crossing(z: Array, upward: Array, energy: Array, weight: Array, heights_m: Array, edges_kev: Array, media: Array) -> Array:
    """Contribution to the flux at the heights of photons from heights z with these cosines to the vertical: (H groups,)."""
    air, soil = (np.interp(energy, GRID_KEV, one)[:, None] for one in media)
    z, upward = z[:, None], np.where(upward == 0.0, 1e-12, upward)[:, None]
    way = (heights_m - z) / upward
    in_soil = np.where(z < 0.0, -z / upward, 0.0)
    steep = np.where(np.abs(upward) > _MIN_COSINE, np.abs(upward), 0.5 * _MIN_COSINE)
    reaching = np.exp(-soil * in_soil - air * (way - in_soil), where=way > 0.0, out=np.zeros_like(way))
    value = weight[:, None] * reaching / steep
    groups = len(edges_kev) - 1
    group = np.broadcast_to((np.searchsorted(edges_kev, energy) - 1)[:, None], value.shape)
    inside = (group >= 0) & (group < groups)
    index = np.arange(len(heights_m)) * groups + np.clip(group, 0, groups - 1)
    result: Array = np.bincount(index[inside], value[inside], len(heights_m) * groups)
    return result
