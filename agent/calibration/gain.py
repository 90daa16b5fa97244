"""The camera's gain: energies by its calibration over true ones, from the full-energy peak of the known nuclide."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from radron.agent.calibration.collection import BLOCKS
from radron.agent.calibration.likelihood import fitted
from radron.agent.detector.lines import GAMMAS
from radron.agent.detector.sensor import energy_variance
from radron.agent.detector.spectroscopy.shapes import lossy, peak_area_mm2, strongest_line_kev
from radron.agent.geometry import Array

SYSTEMATIC = 0.003  # relative: the peak's shape is not known any better
MIN_PEAK_EVENTS = 100  # fewer do not show a peak
MIN_BLOCK_EVENTS = 25
_WINDOW = (0.86, 1.10)  # of the line
_BINS = 70
_LOSS_KEV, _LOSS_SPREAD = 5.0, 0.5  # charge lost below the thresholds, and the spread of its logarithm between cameras
_WIDTH_SPREAD = 0.3  # of the logarithm of the resolution over the assumed one


class Gain(Struct, frozen=True):
    """The measured gain of a camera, or of a part of its sensor.

    value: mean energy read in the line's peak over the line's energy; sigma: its standard deviation; events: in the peak.
    """

    value: float
    sigma: float
    events: float

    def times(self, factor: float) -> Gain:
        """Return the camera's gain, corrected for energies that had been divided by ``factor`` before the fit."""
        return Gain(self.value * factor, self.sigma * factor, self.events)


def fit_gain(energies_kev: Array, nuclide: str) -> tuple[Gain, tuple[float, float]] | None:
    """Fit the gain, near 1, to the energies (N,) of N single clusters; return it with the peak's width and charge loss.

    None with too few events.
    """
    edges, counts = _spectrum(energies_kev, nuclide)
    if counts.sum() < MIN_PEAK_EVENTS:
        return None

    def cost(x: Array) -> float:
        prior: float = 0.5 * (x[1] / _WIDTH_SPREAD) ** 2 + 0.5 * (x[2] / _LOSS_SPREAD) ** 2
        return _cost(counts, edges, nuclide, x[0], (x[1], x[2]), x[3:]) + prior

    total = float(counts.sum())
    start = np.array([1.0, 0.0, 0.0, np.log(0.7 * total), np.log(0.15 * total), np.log(0.15 * total)])
    best, covariance = fitted(cost, start, np.array([0.01, 0.1, 0.3, 0.1, 0.3, 0.3]))
    sigma = float(np.hypot(np.sqrt(covariance[0, 0]), SYSTEMATIC * best[0]))
    events = float(np.exp(best[3]))
    return (Gain(float(best[0]), sigma, events), (float(best[1]), float(best[2]))) if events >= MIN_PEAK_EVENTS else None


def fit_blocks(
    energies_kev: Array, blocks: NDArray[np.intp], nuclide: str, overall: Gain, shape: tuple[float, float]
) -> list[Gain | None]:
    """Return the gain of each of 16 parts (blocks) of the sensor; None for a part with too few events in the peak.

    blocks: (N,) part of each cluster. overall, shape: gain, and width and loss of the peak, for the whole sensor.
    """
    result: list[Gain | None] = []
    for block in range(BLOCKS * BLOCKS):
        edges, counts = _spectrum(energies_kev[blocks == block], nuclide)
        total = float(counts.sum())
        if total < MIN_BLOCK_EVENTS:
            result.append(None)
            continue

        def cost(x: Array, counts: Array = counts, edges: Array = edges) -> float:
            return _cost(counts, edges, nuclide, x[0], shape, x[1:])

        start = np.array([overall.value, np.log(0.7 * total), np.log(0.15 * total), np.log(0.15 * total)])
        best, covariance = fitted(cost, start, np.array([0.01, 0.1, 0.3, 0.3]))
        sigma = float(np.hypot(np.sqrt(covariance[0, 0]), SYSTEMATIC * best[0]))
        result.append(Gain(float(best[0]), sigma, float(np.exp(best[1]))))
    return result


def _spectrum(energies_kev: Array, nuclide: str) -> tuple[Array, Array]:
    """Edges (B + 1,) and counts (B,) around the strongest line."""
    line = strongest_line_kev(nuclide)
    edges = np.linspace(_WINDOW[0] * line, _WINDOW[1] * line, _BINS + 1)
    return edges, np.histogram(energies_kev, edges)[0].astype(np.float64)


def _cost(counts: Array, edges: Array, nuclide: str, gain: float, shape: tuple[float, float], strengths: Array) -> float:
    """Negative log likelihood (Poisson) of counts (B,), less a constant.

    shape: logarithms of width and loss over the assumed ones. strengths: logarithms of the events in the peak, and in a continuum
    that falls to zero at the upper end, and at the lower one.
    """
    if not 0.3 < gain < 3.0 or np.abs(strengths).max() > 50.0:
        return 1e12
    width, loss = np.exp(np.clip(shape[0], -3.0, 3.0)), _LOSS_KEV * np.exp(np.clip(shape[1], -1.5, 1.5))
    gain = gain / (1.0 - loss / strongest_line_kev(nuclide))  # of the charge not lost
    peak = np.zeros(len(counts))
    for energy, photons in GAMMAS[nuclide]:
        if 0.5 * edges[0] < energy * gain < 2.0 * edges[-1]:
            cumulative = lossy(edges / gain - energy, width * energy_variance(energy) ** 0.5, loss)
            peak += photons * peak_area_mm2(energy) * np.diff(cumulative)
    ramp = (np.arange(len(counts)) + 0.5) / len(counts)
    expected = np.exp(strengths[0]) * peak / max(peak.sum(), 1e-12)
    expected += 2.0 / len(counts) * (np.exp(strengths[1]) * (1.0 - ramp) + np.exp(strengths[2]) * ramp)
    expected = np.maximum(expected, 1e-9)
    return float((expected - counts * np.log(expected)).sum())
