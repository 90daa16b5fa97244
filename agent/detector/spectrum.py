"""The coarse spectrum of a camera, as published with its counts."""

from __future__ import annotations

from collections import Counter
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from protocol.spectrum import BINS, HIGHEST_KEV, LOWEST_KEV, SpectrumBin

_LOW_ROOT = sqrt(LOWEST_KEV)
_PER_ROOT = BINS / (sqrt(HIGHEST_KEV) - _LOW_ROOT)


class CoarseSpectrum:
    """Numbers of events by energy, single clusters and coincidences apart; energies beyond the bins are left out."""

    def __init__(self) -> None:
        self._singles: Counter[int] = Counter()
        self._coincidences: Counter[int] = Counter()

    def add(self, energy_kev: float, coincidence: bool) -> None:
        """Add one event; of a coincidence the sum of both energies."""
        if LOWEST_KEV <= energy_kev < HIGHEST_KEV:
            (self._coincidences if coincidence else self._singles)[
                min(int((sqrt(energy_kev) - _LOW_ROOT) * _PER_ROOT), BINS - 1)
            ] += 1

    def add_singles(self, energy_kev: NDArray[np.float64]) -> None:
        """Add single clusters; energy_kev: (N,)."""
        inside = energy_kev[(energy_kev >= LOWEST_KEV) & (energy_kev < HIGHEST_KEV)]
        self._singles.update(np.minimum((np.sqrt(inside) - _LOW_ROOT) * _PER_ROOT, BINS - 1).astype(int).tolist())

    def add_bins(self, bins: tuple[SpectrumBin, ...]) -> None:
        """Add another spectrum."""
        for one in bins:
            self._singles[one.place] += one.singles
            self._coincidences[one.place] += one.coincidences

    def bins(self) -> tuple[SpectrumBin, ...]:
        """The bins with events, in the order of energy."""
        places = sorted({*self._singles, *self._coincidences})
        return tuple(SpectrumBin(place, self._singles[place], self._coincidences[place]) for place in places)
