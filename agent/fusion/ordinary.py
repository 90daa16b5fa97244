"""Counts expected of an ordinary detector over soil, from its table of response.

A becquerel on the ground, at the distance D and at the angle theta from straight down, gives in channel c, per second,

    U_c = exp(-mu D) / (4 pi D^2)  sum_l n_l A_c(E_l, theta),
    S_c = exp(-mu D) / (4 pi D^2)  sum_g F_g(h, r / h) A_c(E_g),

with the lines E_l of n_l photons per decay, effective areas A_c, the attenuation mu of air, and the flux F_g of photons that soil
and air scatter in energy group g (``soilflux``, less the attenuation: height h, horizontal distance r), for which A_c is the mean
over all directions. There are two channels: full energy of the lines, and all other counts; a counter has all in the latter.
"""

from __future__ import annotations

from functools import cached_property
from math import pi
from typing import Final

import numpy as np

from radron.agent.config.responses import ResponseTable
from radron.agent.detector.lines import GAMMAS
from radron.agent.detector.response import Response, cell_of
from radron.agent.errors import ConfigError
from radron.agent.fusion.bayes.response import response_of
from radron.agent.fusion.observation import CountObservation
from radron.agent.fusion.soilflux import EDGES_KEV, HEIGHTS_M, NATURAL, SCATTERED, SLOPES
from radron.agent.geometry import Array

REST, FULL = range(2)  # channels
MIN_DISTANCE_M: Final = 0.3
MIN_BACKGROUND_PS: Final = 1e-3  # of a channel; cosmic rays alone give more
_ANGLES_DEG: Final = np.arange(91.0)
_WIDTH: Final = 0.9  # of the channel of full energy on each side of a line, in FWHM
_M2_PER_CM2: Final = 1e-4


class OrdinaryCounts:
    """Expected counts of one kind of ordinary detector: (2,) channels, partial (``REST``) and full energy (``FULL``)."""

    def __init__(self, table: ResponseTable, nuclide: str) -> None:
        """Raises ConfigError for a nuclide without a table of scattered photons."""
        if nuclide not in SCATTERED:
            raise ConfigError(f"nuclide {nuclide!r}: no table of scattered photons; known: {', '.join(SCATTERED)}")
        self._table, self._response, self._nuclide = table, Response(table), nuclide
        self._air_per_m = response_of(nuclide, "none").air_per_m
        flux = np.array(SCATTERED[nuclide]).reshape(len(HEIGHTS_M), len(SLOPES), -1)
        heights = np.array(HEIGHTS_M)[:, None]
        reached = np.exp(self._air_per_m * np.hypot(heights, heights * np.array(SLOPES)))
        self._scattered: Array = flux @ self._mean_areas * reached[..., None]
        self._log_heights: Array = np.log(HEIGHTS_M)
        self._slopes: Array = np.arcsinh(SLOPES)
        lines = GAMMAS[nuclide]
        by_line = self._parted(self._response.areas_cm2(np.array([line for line, _ in lines]), _ANGLES_DEG))
        self._direct: Array = np.einsum("l,lac->ac", [photons for _, photons in lines], by_line)

    @cached_property
    def _is_full(self) -> Array:
        """(C,) share of the table's channels in that of full energy."""
        edges = self._response.edges_kev
        if self._table.kind == "counts":
            return np.zeros(1)
        constant, linear, square = self._table.fwhm_kev2
        middle = 0.5 * (edges[1:] + edges[:-1])
        full = np.zeros(len(middle), bool)
        for line, _ in GAMMAS[self._nuclide]:
            fwhm = np.sqrt(constant + linear * line + square * line * line)
            full |= np.abs(middle - line) <= max(_WIDTH * fwhm, 0.51 * float(np.diff(edges)[np.argmin(np.abs(middle - line))]))
        return full.astype(float)

    def _parted(self, areas_cm2: Array) -> Array:
        """Areas (..., 2) in m2 of partial and full energy, from areas (..., C) of the table's channels, cm2."""
        full = areas_cm2 @ self._is_full
        found: Array = _M2_PER_CM2 * np.stack((areas_cm2.sum(axis=-1) - full, full), axis=-1)
        return found

    @cached_property
    def _mean_areas(self) -> Array:
        """(G, 2) areas of the energy groups, m2, as means over all directions from below."""
        edges = np.array(EDGES_KEV)
        cosines = (np.arange(10) + 0.5) / 10.0
        areas = self._response.areas_cm2(np.sqrt(edges[1:] * edges[:-1]), np.degrees(np.arccos(cosines)))
        return self._parted(areas.mean(axis=1))

    @property
    def background_ps(self) -> Array:
        """(2,) counts per second by the photons of usual soil, without contamination."""
        found: Array = np.maximum(np.array(NATURAL) @ self._mean_areas, MIN_BACKGROUND_PS)
        return found

    def fits(self, observation: CountObservation) -> bool:
        """Return whether an exposure has the channels of the table; others are none of this detector's."""
        return len(observation.bins) == self._table.channels

    def counted(self, observation: CountObservation) -> tuple[int, ...]:
        """Return the partial-energy and full-energy counts of an exposure."""
        bins = np.array(observation.bins, float)
        full = round(float(bins @ self._is_full))
        return round(float(bins.sum())) - full, full

    def per_bq(self, east: Array, north: Array, height: Array, twice: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return U and S, (..., 2) counts per second of a becquerel on the ground.

        east, north: (...) from the detector to the place, height: (...) of the detector above the ground, metres. twice: not
        used: the table is a mean over all headings.
        """
        horizontal = np.hypot(east, north)
        distance = np.maximum(np.hypot(horizontal, height), MIN_DISTANCE_M)
        per_m2 = np.exp(-self._air_per_m * distance) / (4.0 * pi * distance * distance)
        angle = np.degrees(np.arctan2(horizontal, height))
        direct = np.stack([np.interp(angle, _ANGLES_DEG, self._direct[:, channel]) for channel in range(2)], axis=-1)
        unscattered = per_m2[..., None] * direct
        scattered = per_m2[..., None] * self._between(np.broadcast_to(height, horizontal.shape), horizontal)
        return unscattered, scattered

    def _between(self, height: Array, horizontal: Array) -> Array:
        """Scattered counts (..., 2) times 4 pi D^2 exp(mu D), between the table's heights and slopes; at its edge beyond."""
        low, above = cell_of(np.log(np.maximum(height, HEIGHTS_M[0])), self._log_heights)
        ring, beyond = cell_of(np.arcsinh(horizontal / np.maximum(height, 1e-3)), self._slopes)
        above, beyond, table = above[..., None], beyond[..., None], self._scattered
        lower = (1.0 - beyond) * table[low, ring] + beyond * table[low, ring + 1]
        upper = (1.0 - beyond) * table[low + 1, ring] + beyond * table[low + 1, ring + 1]
        found: Array = (1.0 - above) * lower + above * upper
        return found
