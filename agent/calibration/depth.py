"""The electrons' drift time across the sensor, from the time between the two clusters of a coincidence.

Photons of the line scatter once in the slab (Klein-Nishina) and are absorbed elsewhere in it, both at a depth where the electrons
stay inside. The distribution of the difference of depths follows from geometry and attenuation, and the drift time scales it.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from scipy.special import ndtr

from radron.agent.calibration.collection import MIN_PAIR_KEV
from radron.agent.calibration.likelihood import fitted
from radron.agent.detector.readout import PIXEL_PITCH_MM, SENSOR_PIXELS, SENSOR_THICKNESS_MM
from radron.agent.detector.sensor import DRIFT_NS, ELECTRON_KEV, TRACK_KEV, TRACK_MM, TRACK_POWER, attenuation_per_mm
from radron.agent.geometry import Array

SYSTEMATIC = 0.03  # relative: of the assumed transport
MIN_PAIRS = 150
_PHOTONS = 60_000
_SHAPE_BINS = 40
_BINS = np.arange(0.0, 301.0, 5.0)  # ns
_MIN_SEPARATION_MM = 0.25  # of clusters that do not touch
_SEED = 1  # of a table: the same for every calibration


class Drift(Struct, frozen=True):
    """The measured drift time of electrons across the sensor.

    drift_ns: across the whole thickness; sigma_ns: its standard deviation; pairs: number of coincidences (two clusters of one
    photon) from which it was found.
    """

    drift_ns: float
    sigma_ns: float
    pairs: int


def fit_drift(apart_ns: Array, line_kev: float, directions: list[Array]) -> Drift | None:
    """Fit the drift time of electrons to the time differences (N,) between the clusters of N coincidences; None with too few.

    ``line_kev``: energy of the source's line. ``directions``: of the source in the camera frame, unit vectors, one for each
    facing.
    """
    if len(apart_ns) < MIN_PAIRS:
        return None
    shape = np.mean([depth_differences(line_kev, direction) for direction in directions], axis=0)
    counts = np.histogram(np.abs(apart_ns), _BINS)[0].astype(np.float64)
    total = counts.sum()

    def cost(x: Array) -> float:
        share = 1.0 / (1.0 + np.exp(-x[2]))
        expected = total * ((1.0 - share) * _folded(shape, np.exp(x[0]), np.exp(x[1])) + share / len(counts))
        expected = np.maximum(expected, 1e-9)
        prior: float = 0.5 * ((x[1] - np.log(6.0)) / 0.7) ** 2 + 0.5 * ((x[2] + 4.0) / 1.5) ** 2
        return float((expected - counts * np.log(expected)).sum()) + prior

    best, covariance = fitted(cost, np.array([np.log(DRIFT_NS), np.log(6.0), -4.0]), np.array([0.05, 0.3, 0.7]))
    drift_ns = float(np.exp(best[0]))
    return Drift(drift_ns, drift_ns * float(np.hypot(np.sqrt(covariance[0, 0]), SYSTEMATIC)), len(apart_ns))


def _folded(shape: Array, drift_ns: float, blur_ns: float) -> Array:
    """Share of the pairs in each time bin: absolute differences of depth with a shape (S,), blurred by the clusters' times."""
    middles = (np.arange(len(shape)) + 0.5) / len(shape) * drift_ns
    share = np.zeros(len(_BINS) - 1)
    for sign in (1.0, -1.0):
        share += shape @ np.diff(ndtr((_BINS[None, :] - sign * middles[:, None]) / blur_ns), axis=1)
    return share


def depth_differences(line_kev: float, direction: Array) -> Array:
    """Return the expected distribution of the depth difference between the two clusters of a coincidence (both of one photon).

    It is a histogram (S,) over S shares of the sensor's thickness, for photons from one direction, by a Monte Carlo calculation.
    line_kev: energy of the photons. direction: unit vector to the source, camera frame.
    """
    rng = np.random.default_rng(_SEED)
    photo, total = attenuation_arrays(np.array([line_kev]))
    half = 0.5 * SENSOR_THICKNESS_MM
    sideways = 0.5 * SENSOR_PIXELS * PIXEL_PITCH_MM
    place = rng.uniform(-1.0, 1.0, (_PHOTONS, 3)) * (sideways, sideways, half)
    incoming = -direction
    depth_mm = half - np.sign(direction[2] or 1.0) * place[:, 2]  # of material before it, along the normal
    path_mm = depth_mm / max(abs(float(direction[2])), 0.15)
    weight = np.exp(-total[0] * path_mm)
    cosine = rng.uniform(-1.0, 1.0, _PHOTONS)
    ratio = 1.0 / (1.0 + line_kev / ELECTRON_KEV * (1.0 - cosine))
    weight *= ratio * ratio * (ratio + 1.0 / ratio - (1.0 - cosine * cosine))
    scattered_kev = line_kev * ratio
    inside = np.abs(place[:, 2]) <= half - _track_mm(line_kev - scattered_kev)
    weight *= (line_kev - scattered_kev >= MIN_PAIR_KEV) & (scattered_kev >= MIN_PAIR_KEV)
    outgoing = _turned(incoming, cosine, rng.uniform(0.0, 2.0 * np.pi, _PHOTONS))
    photo, total = attenuation_arrays(scattered_kev)
    length_mm = rng.exponential(1.0, _PHOTONS) * 2.0  # sampled with a mean of 2 mm, weighted to the attenuation
    weight *= photo * np.exp(-total * length_mm) / np.exp(-length_mm / 2.0)
    end = place + length_mm[:, None] * outgoing
    inside &= (np.abs(end[:, :2]) <= sideways).all(axis=1) & (np.abs(end[:, 2]) <= half - _track_mm(scattered_kev))
    apart = np.hypot(*(end - place)[:, :2].T) >= _MIN_SEPARATION_MM
    difference = np.abs(end[:, 2] - place[:, 2]) / SENSOR_THICKNESS_MM
    shape = np.histogram(difference, _SHAPE_BINS, (0.0, 1.0), weights=weight * inside * apart)[0]
    result: Array = shape / shape.sum()
    return result


def _track_mm(energy_kev: Array) -> Array:
    """Distance from the surfaces (N,) within which an electron's energy is not fully deposited."""
    track_mm: Array = TRACK_MM * (energy_kev / TRACK_KEV) ** TRACK_POWER
    return track_mm


def attenuation_arrays(energy_kev: Array) -> tuple[Array, Array]:
    """Return the photoelectric and total attenuation coefficients (1/mm) of the sensor at N energies (N,)."""
    grid = np.geomspace(max(10.0, 0.9 * float(energy_kev.min())), 1.1 * float(energy_kev.max()), 60)
    table = np.log(np.array([attenuation_per_mm(float(kev)) for kev in grid]))
    photo, total = (np.exp(np.interp(np.log(energy_kev), np.log(grid), column)) for column in table.T)
    return photo, total


def _turned(axis: Array, cosine: Array, turn: Array) -> Array:
    """Unit vectors (N, 3) at angles with these cosines (N,) to the axis, turned about it."""
    u = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    sine = np.sqrt(1.0 - cosine * cosine)
    result: Array = cosine[:, None] * axis + sine[:, None] * (np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * v)
    return result
