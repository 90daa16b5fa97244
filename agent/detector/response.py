"""Effective areas of an ordinary detector by energy, direction and channel, from its table of response."""

from __future__ import annotations

from math import log, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from radron.agent.config.responses import ResponseTable

Array = NDArray[np.float64]

_FWHM_PER_SIGMA = sqrt(8.0 * log(2.0))


class Response:
    """Response of an ordinary detector.

    edges_kev: (C + 1,) edges of its channels. Full-energy counts are a Gaussian of the detector's resolution about the photon's
    own energy; all other counts are interpolated between the table's energies, in their logarithm, and between its angles.
    """

    def __init__(self, table: ResponseTable) -> None:
        self.edges_kev: Array = np.array(table.edges_kev)
        self._fwhm_kev2 = table.fwhm_kev2
        self._log_energy: Array = np.log(table.energies_kev)
        self._angles_deg: Array = np.array(table.angles_deg)
        self._peak: Array = np.array(table.peak_cm2)
        self._rest: Array = np.array(table.rest_cm2)

    @property
    def channels(self) -> int:
        """Number of the channels."""
        return len(self.edges_kev) - 1

    def peak_cm2(self, energies_kev: Array, angles_deg: Array) -> Array:
        """Return the effective areas for counts of the full energy, (N, M) cm2, for N energies and M angles from straight
        down.
        """
        return self._between(self._peak[:, :, None], energies_kev, angles_deg)[:, :, 0]

    def areas_cm2(self, energies_kev: Array, angles_deg: Array) -> Array:
        """Return the effective areas for counts in each channel, (N, M, C) cm2, for N energies and M angles from straight down.

        Energies beyond the table's take the areas at its end.
        """
        energies_kev = np.asarray(energies_kev, float)
        constant, linear, square = self._fwhm_kev2
        squared = constant + linear * energies_kev + square * energies_kev**2
        sigma_kev = np.sqrt(np.maximum(squared, 1e-6)) / _FWHM_PER_SIGMA
        below = ndtr((self.edges_kev[None, :] - energies_kev[:, None]) / sigma_kev[:, None])
        peak = self.peak_cm2(energies_kev, angles_deg)[:, :, None] * np.diff(below, axis=1)[:, None, :]
        found: Array = self._between(self._rest, energies_kev, angles_deg) + peak
        return found

    def _between(self, values: Array, energies_kev: Array, angles_deg: Array) -> Array:
        """Interpolate values (E, D, K) of the table; (N, M, K)."""
        angles = np.abs(np.asarray(angles_deg, float))
        if self._angles_deg[-1] == 90.0:
            angles = np.minimum(angles, 180.0 - angles)
        low, share = cell_of(np.log(energies_kev), self._log_energy)
        rows = values[low] * (1.0 - share)[:, None, None] + values[low + 1] * share[:, None, None]
        if len(self._angles_deg) == 1:
            return np.repeat(rows, len(angles), axis=1)
        low, share = cell_of(angles, self._angles_deg)
        found: Array = rows[:, low] * (1.0 - share)[None, :, None] + rows[:, low + 1] * share[None, :, None]
        return found


def cell_of(at: Array, grid: Array) -> tuple[NDArray[np.intp], Array]:
    """Return the cell of a rising grid for each value, and the share of the way through it, within the grid's ends."""
    low = np.clip(np.searchsorted(grid, at, side="right") - 1, 0, len(grid) - 2)
    share: Array = np.clip((at - grid[low]) / (grid[low + 1] - grid[low]), 0.0, 1.0)
    return low, share
