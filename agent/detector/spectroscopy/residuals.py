"""Peaks that a fitted spectrum does not explain, or lacks: whether a nuclide fits, and the lines of an unknown nuclide.

Both are judged by a matched filter: the residuals of the fit, weighted by their variance, against the shape of a single line. The
model is good to some per cent, so its share enters the variance: however many events there are, small deviations prove nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache

import numpy as np

from radron.agent.detector.spectroscopy.shapes import MIDDLES_KEV, of_nuclide, peaks
from radron.agent.geometry import Array

_MODEL_ERROR = 0.2  # relative, of each bin: shapes of peaks, humps in the place of scattered photons
MORE_SIGMAS = 7.0  # of a peak that is not explained; spectra of known nuclides reach 6
LESS_SIGMAS = 4.5  # of a missing peak; lines of known nuclides reach 3.5
_MAX_LINES = 6
_APART = 0.07  # relative distance of two distinguishable lines
_ROUNDS = 150

Fitted = Callable[[Array, Array, Array | None, int], tuple[Array, Array]]


def contradiction(counts: Array, expected: Array, lines_kev: Iterable[float]) -> str | None:
    """Return, in words, a peak that is measured but not expected for a nuclide, or expected but not measured; None if there is
    none.

    counts: (B,) measured events in B energy bins. expected: (B,) events by the fitted nuclide. lines_kev: the nuclide's lines, as
    this camera reads them.
    """
    sigmas = _sigmas(counts, expected)
    more = int(sigmas.argmax())
    if sigmas[more] > MORE_SIGMAS:
        return f"a peak at {MIDDLES_KEV[more]:.0f} keV is not its own"
    missing = [line for line in lines_kev if sigmas[int(np.abs(MIDDLES_KEV - line).argmin())] < -LESS_SIGMAS]
    return f"its peak at {missing[0]:.0f} keV is missing" if missing else None


def line_energies(counts: Array, common: Array, fitted: Fitted) -> tuple[int, ...]:
    """Return the energies (keV, ascending) of the peaks in a spectrum that the given components do not explain.

    The most significant peak is found first, then the next, with this peak and its continuum among the components.

    counts: (B,) events in B energy bins. common: (K, B) K component spectra. fitted: the function for the fit.
    """
    parts, found = common, list[float]()
    while len(found) < _MAX_LINES:
        _, shares = fitted(counts, parts[None], None, _ROUNDS)
        sigmas = _sigmas(counts, shares[0] @ parts * counts.sum())
        for known in found:
            sigmas[np.abs(np.log(MIDDLES_KEV / known)) < _APART] = 0.0
        place = int(sigmas.argmax())
        if sigmas[place] < MORE_SIGMAS:
            break
        energy = float(MIDDLES_KEV[place])
        found.append(energy)
        parts = np.concatenate((parts, of_nuclide(((energy, 1.0),))))
    return tuple(round(energy) for energy in sorted(found))


def told(lines_kev: Iterable[int]) -> str:
    """Return line energies as text for people: "122, 136 keV"."""
    return f"{', '.join(map(str, lines_kev))} keV"


def _sigmas(counts: Array, expected: Array) -> Array:
    """(B,) significance of a line at the energy of each bin."""
    variance = expected + (_MODEL_ERROR * expected) ** 2 + 1e-9
    lines = single_lines()
    result: Array = (lines @ ((counts - expected) / variance)) / np.sqrt(lines**2 @ (1.0 / variance))
    return result


@cache
def single_lines() -> Array:
    """Return the peaks (B, B) of single gamma lines over B energy bins: row i has a line in the middle of bin i.
    Computed once.
    """
    return np.array([peaks(((energy, 1.0),)) for energy in MIDDLES_KEV.tolist()])
