"""The coarse spectrum of a camera, as published with its counts."""

from __future__ import annotations

from collections import Counter
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from radron.protocol.spectrum import BINS, HIGHEST_KEV, LOWEST_KEV, SpectrumBin

_LOW_ROOT = sqrt(LOWEST_KEV)
_PER_ROOT = BINS / (sqrt(HIGHEST_KEV) - _LOW_ROOT)


class CoarseSpectrum:
    """A histogram of event energies in a few bins, small enough to be sent by radio with a camera's counts.

    Single clusters and coincidences (two clusters of one photon) are counted separately; energies beyond the bins are left out.
    """

    def __init__(self) -> None:
        self._singles: Counter[int] = Counter()
        self._coincidences: Counter[int] = Counter()

    def add(self, energy_kev: float, coincidence: bool) -> None:
        """Add the energy of one event; for a coincidence the sum of both clusters' energies."""
        if LOWEST_KEV <= energy_kev < HIGHEST_KEV:
            (self._coincidences if coincidence else self._singles)[
                min(int((sqrt(energy_kev) - _LOW_ROOT) * _PER_ROOT), BINS - 1)
            ] += 1

    def add_singles(self, energy_kev: NDArray[np.float64]) -> None:
        """Add the energies (N,) in keV of N events with a single cluster."""
        inside = energy_kev[(energy_kev >= LOWEST_KEV) & (energy_kev < HIGHEST_KEV)]
        self._singles.update(np.minimum((np.sqrt(inside) - _LOW_ROOT) * _PER_ROOT, BINS - 1).astype(int).tolist())

    def add_bins(self, bins: tuple[SpectrumBin, ...]) -> None:
        """Add the counts of another histogram of event energies."""
        for one in bins:
            self._singles[one.place] += one.singles
            self._coincidences[one.place] += one.coincidences

    def bins(self) -> tuple[SpectrumBin, ...]:
        """Return the energy bins that have events, in the order of energy."""
        places = sorted({*self._singles, *self._coincidences})
        return tuple(SpectrumBin(place, self._singles[place], self._coincidences[place]) for place in places)
