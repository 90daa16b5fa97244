"""Expected counts above contaminated ground, and their derivatives.

For the sum r of drone d, in channel c, with the live time T_r, the kernels U and S (``kernel``) and the background B_c,

    lambda_rc = T_r exp(g_d) [exp(v_c) B_c + sum_j (U_rcj + exp(s) S_rcj) a_j + (U_rc + exp(s) S_rc) b],

a_j activity per area of cell j, linear in the coefficients u of ``grid.Grid``, and b the same of all ground beyond the grid.
They are fitted together with the error of the background (v). Errors of the soil's scatter (s), and of each drone's sensitivity
(g), place (x, y) and height (z) are zero in a fit, and widen its intervals by their derivatives: a drone off by x counts as if
the ground was off by -x. The linear link lets a be negative: only then are totals unbiased.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from radron.agent.fusion.bayes.soil import SCATTER_SIGMA
from radron.agent.fusion.field.grid import Grid
from radron.agent.fusion.field.kernel import AnyDetector, Floats, Kernels, backgrounds
from radron.agent.fusion.field.sums import Sums
from radron.agent.geometry import Array

BIASES: Final = 4  # of each drone: place (2) and height, metres; logarithm of the sensitivity
HEIGHT_SIGMA_M: Final = 0.5
CHANNEL_SIGMA: Final = 0.1  # of a channel's background beside the others'
_MODEL_ERROR: Final = 0.05  # no sum measures its rate better than to this share
MIN_SHARE: Final = 0.3  # of the background: least expectation, where the linear link is negative


@dataclass(frozen=True, eq=False)
class Solution:
    """ground: (K,) u and b, Bq/m2, or (0,) without contaminated area. background: (C,) v."""

    ground: Array
    background: Array

    @classmethod
    def nothing(cls, channels: int) -> Solution:
        """Return background alone, as expected."""
        return cls(np.zeros(0), np.zeros(channels))

    @property
    def vector(self) -> Array:
        """All fitted numbers."""
        return np.concatenate((self.ground, self.background))

    def moved(self, to: Array) -> Solution:
        """Return the solution with another ``vector``."""
        ground = len(self.ground)
        return Solution(to[:ground], to[ground:])


@dataclass(frozen=True, eq=False)
class Priors:
    """1 sigma of the logarithm of the background (of all channels), of each drone's place (D,), and of the sensitivity."""

    background: float
    place_m: Array
    gain: float

    def precision(self, solution: Solution, of_ground: Array) -> Array:
        """Return the precision matrix of a solution's vector. of_ground: (K,) of u and b."""
        ground, channels = len(solution.ground), len(solution.background)
        result = np.zeros((ground + channels,) * 2)
        result[range(ground), range(ground)] = of_ground[:ground]
        own = np.full((channels, channels), self.background**2) + CHANNEL_SIGMA**2 * np.eye(channels)
        result[ground:, ground:] = np.linalg.inv(own)
        return result

    @property
    def of_errors(self) -> Array:
        """(E,) precisions of the errors that are zero in a fit: soil's scatter, and ``BIASES`` of each drone."""
        place = self.place_m**-2.0
        others = np.stack((place, place, np.full(len(place), HEIGHT_SIGMA_M**-2), np.full(len(place), self.gain**-2)), axis=1)
        return np.array([SCATTER_SIGMA**-2, *others.ravel()])


class CountModel:
    """The sums with every term that does not depend on the solution."""

    def __init__(
        self, sums: Sums, height: Array, kernels: Kernels, grid: Grid, detector: AnyDetector, amplitude: Array | None = None
    ) -> None:
        """height: (R,) of the detectors above the ground, metres. amplitude: (N,) factor of the prior's scale in each cell."""
        self.amplitude: Array = np.ones(grid.size) if amplitude is None else amplitude
        self.sums, self.kernels, self.grid, self._detector = sums, kernels, grid, detector
        self.height, self.counts, self.live_s, self.drone = height, sums.counts, sums.live_s, sums.drone
        self.background = self.live_s[:, None] * backgrounds(detector, self.drone)
        self.weight: Array = 1.0 / (1.0 + _MODEL_ERROR**2 * self.counts.sum(axis=1, keepdims=True))

    @cached_property
    def _template(self) -> Array:
        """(R, C, K) counts by the coefficients and by the ground beyond, live time left out."""
        of_cells = self.grid.projected(self.kernels.every * self.amplitude.astype(np.float32))
        return np.concatenate((of_cells, self.kernels.beyond.sum(axis=0)[..., None]), axis=2)

    def shaped(self, amplitude: Array) -> CountModel:
        """Return the model with another amplitude."""
        return CountModel(self.sums, self.height, self.kernels, self.grid, self._detector, amplitude)

    def activity(self, solution: Solution) -> Array:
        """Return a (N,) of a solution with a contaminated area, Bq/m2."""
        return self.amplitude * self.grid.field(solution.ground[:-1])

    def functionals(self, weights: Array) -> Array:
        """Return (B, K): sums over the cells of weights (B, N) times the activity, as functions of the ground's numbers."""
        table = self.grid.projected(weights * self.amplitude)
        return np.concatenate((table, np.zeros((len(table), 1))), axis=1)

    def expected(self, solution: Solution) -> Array:
        """Return lambda, (R, C)."""
        result = self.background * np.exp(solution.background)
        if len(solution.ground):
            result = result + self.live_s[:, None] * (self._template @ solution.ground)
        return np.maximum(result, MIN_SHARE * self.background)

    def log_likelihood(self, expected: Array) -> float:
        """Return the log likelihood, without the terms that do not depend on the solution."""
        return float((self.weight * (self.counts * np.log(expected) - expected)).sum())

    def jacobian(self, solution: Solution) -> Array:
        """Return the derivatives (R C, p) of lambda by the solution's vector."""
        rows, channels = self.counts.shape
        own = (self.background * np.exp(solution.background))[..., None] * np.eye(channels)
        if len(solution.ground):
            own = np.concatenate((self.live_s[:, None, None] * self._template, own), axis=2)
        return own.reshape(rows * channels, -1)

    def by_errors(self, solution: Solution, drones: int) -> Array:
        """Return the derivatives (R C, E) of lambda by the errors that are zero in a fit, as of ``Priors.of_errors``."""
        rows, channels = self.counts.shape
        live_s = self.live_s[:, None]
        by_scatter, slopes = np.zeros((rows, channels)), np.zeros((3, rows, channels))
        if len(solution.ground):
            field = self.activity(solution)
            scattered = self.kernels.scattered @ field.astype(np.float32)
            by_scatter = live_s * (scattered + self.kernels.beyond[1] * solution.ground[-1])
            slopes = self._slopes(field) * live_s
        biased = np.stack((*slopes, self.expected(solution)), axis=2)
        of_drones = [biased * (self.drone == drone)[:, None, None] for drone in range(drones)]
        return np.concatenate((by_scatter[..., None], *of_drones), axis=2).reshape(rows * channels, -1)

    @cached_property
    def _falls(self) -> Floats:
        """(R, N) derivatives of the logarithm of a cell's counts by the drone's height, as of photons from a point."""
        east, north = (
            np.square(self.grid.centres[:, axis].astype(np.float32) - self.sums.place[:, axis, None].astype(np.float32))
            for axis in range(2)
        )
        height = self.height[:, None].astype(np.float32)
        return np.asarray(-2.0 * height / (east + north + height * height), np.float32)

    def _slopes(self, activity: Array) -> Array:
        """Return (3, R, C) derivatives of the counts of an activity (N,) by the drone's place and height, live time left out."""
        grid = self.grid
        north, east = np.gradient(activity.reshape(grid.rows, grid.columns), grid.cell_m)
        level = np.stack((east.ravel(), north.ravel()), axis=1).astype(np.float32)
        moved = np.asarray(self.kernels.every @ level, np.float64)
        lower = np.matmul(self.kernels.every, (self._falls * activity.astype(np.float32))[..., None])[..., 0]
        return np.stack((moved[..., 0], moved[..., 1], np.asarray(lower, np.float64)))


def of_drones(values: Sequence[float]) -> Array:
    """Return position errors along one axis (D,) from horizontal ones (2D), at least a centimetre."""
    result: Array = np.maximum(np.array(values, np.float64) / np.sqrt(2.0), 0.01)
    return result
