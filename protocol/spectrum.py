"""The coarse spectrum of an exposure: 32 bins from 40 to 1450 keV, of equal width in the square root of the energy.

A bin is 13 keV wide at 40 keV, 51 keV at 662 keV and 75 keV at the end, about in step with the resolution of a pixel detector.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from math import sqrt
from typing import Annotated

from msgspec import Meta, Struct

from radron.protocol.units import Count

BINS = 32
LOWEST_KEV, HIGHEST_KEV = 40.0, 1450.0
_STEP = (sqrt(HIGHEST_KEV) - sqrt(LOWEST_KEV)) / BINS
EDGES_KEV = (*((sqrt(LOWEST_KEV) + place * _STEP) ** 2 for place in range(BINS)), HIGHEST_KEV)


class SpectrumBin(Struct, frozen=True, array_like=True):
    """Numbers of events in one energy bin of a spectrum, the bin with index ``place``.

    ``singles``: single clusters (adjacent pixels hit by one particle), by their energy. ``coincidences``: pairs of simultaneous
    clusters, by the sum of their energies.
    """

    place: Annotated[int, Meta(ge=0, le=BINS - 1)]
    singles: Count
    coincidences: Count


Line = Annotated[int, Meta(ge=1, le=2000)]  # energy of a spectral line, keV
Spectrum = Annotated[tuple[SpectrumBin, ...], Meta(max_length=BINS)]  # bins without events are left out


def unknown_nuclide(lines_kev: Iterable[int]) -> str:
    """Return the display text for a source that no candidate nuclide explains, such as "unknown, lines at 136, 265 keV"."""
    lines = ", ".join(map(str, lines_kev))
    return f"unknown, lines at {lines} keV" if lines else "unknown, no clear lines"


def is_in_order(spectrum: tuple[SpectrumBin, ...]) -> bool:
    """Return whether the bins of a spectrum ascend in energy, and none occurs twice."""
    return all(before.place < after.place for before, after in pairwise(spectrum))
