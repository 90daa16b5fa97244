"""Expected counts above contaminated ground, and their derivatives.

For the sum r of drone d, in channel c, with the live time T_r, the kernels U and S (``kernel``) and the background B_c,

    lambda_rc = T_r exp(g_d) [exp(v_c) B_c + sum_j (U_rcj + exp(s) S_rcj) a_j + (U_rc + exp(s) S_rc) b],

a_j activity per area of cell j, linear in the coefficients u of ``grid.Grid``, and b the same of all ground beyond the grid.
The error of the background (v) is fitted with it. Errors of the soil's scatter (s), and of each drone's sensitivity (g), place
(x, y) and height (z) stay at zero, and widen the intervals by their derivatives: a drone off by x counts as if the ground was off
by -x. The linear link lets a be negative: only then are totals
unbiased.
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
_MIN_SHARE: Final = 0.3  # of the background: least expectation, where the linear link is negative


@dataclass(frozen=True, eq=False)
class Solution:
    """ground: (K,) u and b, Bq/m2, or (0,) without contaminated area. background: (C,) v. scatter: s. bias: (D, BIASES)."""

    ground: Array
    background: Array
    scatter: float
    bias: Array

    @classmethod
    def nothing(cls, channels: int, drones: int) -> Solution:
        """Return background alone, without errors."""
        return cls(np.zeros(0), np.zeros(channels), 0.0, np.zeros((drones, BIASES)))

    @property
    def vector(self) -> Array:
        """All fitted numbers."""
        return np.concatenate((self.ground, self.background, [self.scatter], self.bias.ravel()))

    @property
    def errors(self) -> slice:
        """Place of scatter and drones' errors in the vector."""
        return slice(len(self.ground) + len(self.background), len(self.ground) + len(self.background) + 1 + self.bias.size)

    def moved(self, to: Array) -> Solution:
        """Return the solution with another ``vector``."""
        ground, errors = len(self.ground), self.errors
        bias = to[errors][1:].reshape(self.bias.shape)
        return Solution(to[:ground], to[ground : errors.start], float(to[errors.start]), bias)


@dataclass(frozen=True, eq=False)
class Priors:
    """1 sigma of the logarithm of the background (of all channels), of each drone's place (D,), and of the sensitivity."""

    background: float
    place_m: Array
    gain: float

    def precision(self, solution: Solution, of_ground: Array) -> Array:
        """Return the precision matrix of a solution's vector. of_ground: (K,) of u and b."""
        channels = len(solution.background)
        result = np.zeros((len(solution.vector),) * 2)
        ground = len(solution.ground)
        result[range(ground), range(ground)] = of_ground[:ground]
        own = np.full((channels, channels), self.background**2) + CHANNEL_SIGMA**2 * np.eye(channels)
        rest = ground + channels
        result[ground:rest, ground:rest] = np.linalg.inv(own)
        place = self.place_m**-2.0
        others = np.stack((place, place, np.full(len(place), HEIGHT_SIGMA_M**-2), np.full(len(place), self.gain**-2)), axis=1)
        numbers = range(rest, solution.errors.stop)
        result[numbers, numbers] = [SCATTER_SIGMA**-2, *others.ravel()]
        return result


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
    def _templates(self) -> tuple[Array, Array]:
        """(R, C, K) kernels U and S of the coefficients and of the ground beyond."""
        parts, factor = (self.kernels.direct, self.kernels.scattered), self.amplitude.astype(np.float32)
        direct, scattered = (
            np.concatenate((self.grid.projected(part * factor), beyond[..., None]), axis=2)
            for part, beyond in zip(parts, self.kernels.beyond, strict=True)
        )
        return direct, scattered

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

    def per_cell(self, solution: Solution) -> Floats:
        """Return (R, C, N) counts by a becquerel per m2 in each cell, with the solution's scatter, live time left out."""
        return self.kernels.direct + np.float32(np.exp(solution.scatter)) * self.kernels.scattered

    def _exposed(self, solution: Solution) -> Array:
        result: Array = (self.live_s * np.exp(solution.bias[self.drone, 3]))[:, None]
        return result

    def expected(self, solution: Solution) -> Array:
        """Return lambda, (R, C)."""
        signal = self.background * np.exp(solution.background) / self.live_s[:, None]
        if len(solution.ground):
            direct, scattered = self._templates
            signal = signal + direct @ solution.ground + np.exp(solution.scatter) * (scattered @ solution.ground)
        return np.maximum(self._exposed(solution) * signal, _MIN_SHARE * self.background)

    def log_likelihood(self, expected: Array) -> float:
        """Return the log likelihood, without the terms that do not depend on the solution."""
        return float((self.weight * (self.counts * np.log(expected) - expected)).sum())

    def jacobian(self, solution: Solution) -> Array:
        """Return the derivatives (R C, p) of lambda by the solution's vector."""
        exposed = self._exposed(solution)
        rows, channels = self.counts.shape
        more = np.exp(solution.scatter)
        columns: list[Array] = []
        by_scatter, slopes = np.zeros((rows, channels)), np.zeros((3, rows, channels))
        if len(solution.ground):
            direct, scattered = self._templates
            columns.append(exposed[..., None] * (direct + more * scattered))
            by_scatter = exposed * (more * (scattered @ solution.ground))
            slopes = slopes + self._slopes(solution) * exposed
        own = exposed * (self.background * np.exp(solution.background) / self.live_s[:, None])
        columns.append(own[..., None] * np.eye(channels))
        columns.append(by_scatter[..., None])
        biased = np.stack((*slopes, self.expected(solution)), axis=2)
        for drone in range(len(solution.bias)):
            columns.append(biased * (self.drone == drone)[:, None, None])
        return np.concatenate(columns, axis=2).reshape(rows * channels, -1)

    @cached_property
    def _falls(self) -> Floats:
        """(R, N) derivatives of the logarithm of a cell's counts by the drone's height, as of photons from a point."""
        east, north = (
            np.square(self.grid.centres[:, axis].astype(np.float32) - self.sums.place[:, axis, None].astype(np.float32))
            for axis in range(2)
        )
        height = self.height[:, None].astype(np.float32)
        return np.asarray(-2.0 * height / (east + north + height * height), np.float32)

    def _slopes(self, solution: Solution) -> Array:
        """Return (3, R, C) derivatives of the ground's counts by the drone's place and height, live time left out."""
        grid = self.grid
        field = self.activity(solution).reshape(grid.rows, grid.columns)
        north, east = np.gradient(field, grid.cell_m)
        per_cell = self.per_cell(solution)
        level = np.stack((east.ravel(), north.ravel()), axis=1).astype(np.float32)
        moved = np.asarray(per_cell @ level, np.float64)
        lower = np.matmul(per_cell, (self._falls * field.ravel().astype(np.float32))[..., None])[..., 0]
        return np.stack((moved[..., 0], moved[..., 1], np.asarray(lower, np.float64)))


def of_drones(values: Sequence[float]) -> Array:
    """Return position errors along one axis (D,) from horizontal ones (2D), at least a centimetre."""
    result: Array = np.maximum(np.array(values, np.float64) / np.sqrt(2.0), 0.01)
    return result
