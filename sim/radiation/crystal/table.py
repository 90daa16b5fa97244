"""Tables of response in the agent's file format (docs/ordinary.md), computed by transport."""

from __future__ import annotations

import json
import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from radron.sim.radiation.crystal.detectors import STEP_KEV, Detector, detector, effective_areas

FloatArray = NDArray[np.float64]

FORMAT = "radron-response-1"
CHANNELS, MIN_CHANNEL_KEV, MAX_CHANNEL_KEV = 64, 30.0, 3000.0
ANGLES_DEG = (0.0, 30.0, 60.0, 90.0)
LINES_KEV = (59.5, 80.998, 122.06, 186.2, 238.6, 364.49, 511.0, 609.3, 661.657, 911.2, 1173.23, 1332.49, 1460.82, 1764.5, 2614.5)
_BETWEEN = np.geomspace(30.0, 2990.0, 36)
_NEAR = 0.04  # energies this near to a line, relative, are left to it
_FWHM_PER_SIGMA = math.sqrt(8.0 * math.log(2.0))


def energies_kev() -> FloatArray:
    """Return the energies of the tables: gamma lines of frequent nuclides, and others between them."""
    others = [energy for energy in _BETWEEN if all(abs(energy / line - 1.0) > _NEAR for line in LINES_KEV)]
    return np.array(sorted((*LINES_KEV, *others)))


def channel_edges_kev(kind: str) -> FloatArray:
    """Return the edges of the channels: of equal width in the root of the energy; one channel for a counter."""
    if kind == "counts":
        return np.array([MIN_CHANNEL_KEV, MAX_CHANNEL_KEV])
    return np.asarray(np.linspace(math.sqrt(MIN_CHANNEL_KEV), math.sqrt(MAX_CHANNEL_KEV), CHANNELS + 1) ** 2)


def smeared(
    found: Detector, at_kev: FloatArray, areas_cm2: FloatArray, edges_kev: FloatArray, resolution: float = 1.0
) -> FloatArray:
    """Return areas by channel (C,), cm2, from areas by deposited energy, with the detector's resolution.

    at_kev, areas_cm2: (N,) energies of the deposits, and their areas. edges_kev: (C + 1,). resolution: factor on the width.
    """
    some = areas_cm2 > 0.0
    sigma = resolution * found.fwhm_kev(at_kev[some]) / _FWHM_PER_SIGMA
    below = ndtr((edges_kev[None, :] - at_kev[some, None]) / sigma[:, None])
    return np.asarray(areas_cm2[some] @ np.diff(below, axis=1))


def response_table(name: str, histories: int, seed: int) -> str:
    """Return the table of response of an ordinary detector as text (JSON); histories: photons for each energy and angle.

    Raises ConfigError for an unknown detector.
    """
    found, rng = detector(name), np.random.default_rng(seed)
    energies, edges = energies_kev(), channel_edges_kev(detector(name).kind)
    peak, rest = [], []
    for energy in energies:
        row = [effective_areas(name, float(energy), angle, histories, rng) for angle in ANGLES_DEG]
        peak.append([_rounded(full) for full, _ in row])
        rest.append([[_rounded(area) for area in _by_channel(found, deposits, edges)] for _, deposits in row])
    table = {
        "format": FORMAT,
        "name": name,
        "kind": found.kind,
        "about": f"{found.about}; radron-sim response {name} --histories {histories} --seed {seed}",
        "edges_kev": [_rounded(edge, 6) for edge in edges],
        "fwhm_kev2": [0.0, _rounded(found.fwhm_share**2 * 661.657), 0.0],
        "energies_kev": [_rounded(energy, 6) for energy in energies],
        "angles_deg": list(ANGLES_DEG),
        "peak_cm2": peak,
        "rest_cm2": rest,
    }
    lines = (f"{json.dumps(key)}: {json.dumps(value, separators=(',', ':'))}" for key, value in table.items())
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _by_channel(found: Detector, deposits_cm2: FloatArray, edges_kev: FloatArray) -> FloatArray:
    if found.kind == "counts":
        return deposits_cm2
    middles_kev: FloatArray = STEP_KEV * (np.arange(len(deposits_cm2), dtype=np.float64) + 0.5)
    return smeared(found, middles_kev, deposits_cm2, edges_kev)


def _rounded(value: float, digits: int = 4) -> float:
    return float(f"{value:.{digits}g}") if abs(value) >= 1e-6 else 0.0
