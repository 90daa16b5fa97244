"""The map with no negative activity: a softplus link, a_j = c ln(1 + exp(f_j)), f = m + phi u.

It draws sharper edges than the linear link, but turns doubt about the background into a floor over the whole area: totals and
intervals are the linear fit's. The background is fixed at that of the linear fit.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from radron.agent.fusion.field.fit import Fitted
from radron.agent.fusion.field.model import MIN_SHARE, CountModel
from radron.agent.geometry import Array

MEAN: Final = -2.0  # m: a tenth of c
SIGMA: Final = 3.0  # of f
LENGTH_M: Final = 10.0
_SHARE: Final = 0.3  # c relative to the scale and the mean of the linear fit
_FLOOR: Final = 0.05  # of c, for the logarithm of the start
_MAX_STEP: Final = 6.0


def softplus(values: Array) -> Array:
    """Return ln(1 + e^f)."""
    result: Array = np.logaddexp(0.0, values)
    return result


class PositiveMap:
    """Fits the map beside a linear fit with a contaminated area."""

    def __init__(self, model: CountModel, linear: Fitted) -> None:
        self._model, self._linear = model, linear
        self.scale = _SHARE * math.hypot(linear.smoothness.scale, float(linear.solution.ground[0]))
        self._precision = 1.0 / (SIGMA**2 * model.grid.spectrum(LENGTH_M))
        self._live_s = model.live_s[:, None].astype(np.float32)
        alone = model.expected(linear.solution) - model.live_s[:, None] * self._signal(model.activity(linear.solution))
        self._other: Array = np.maximum(alone, MIN_SHARE * model.background)

    def _signal(self, activity: Array) -> Array:
        return np.asarray(self._model.kernels.every @ activity.astype(np.float32), np.float64)

    def activity(self, coefficients: Array) -> Array:
        """Return a (N,), Bq/m2."""
        return self.scale * softplus(MEAN + self._model.grid.field(coefficients))

    def start(self) -> Array:
        """Return coefficients (modes,) from the linear fit's map."""
        grid = self._model.grid
        share = np.maximum(self._model.activity(self._linear.solution) / self.scale, _FLOOR)
        wanted = share + np.log(-np.expm1(-share)) - MEAN  # ln(e^share - 1), which would overflow
        result: Array = grid.projected(wanted) / grid.size
        return result

    def fitted(self, start: Array, iterations: int) -> Array:
        """Return coefficients after Fisher scoring from others, each step halved until the density rises."""
        found = start
        for _ in range(iterations):
            found = self._stepped(found)
        return found

    def _density(self, coefficients: Array) -> float:
        expected = self._other + self._live_s * self._signal(self.activity(coefficients))
        return self._model.log_likelihood(expected) - 0.5 * float(self._precision @ coefficients**2)

    def _stepped(self, coefficients: Array) -> Array:
        model, grid = self._model, self._model.grid
        latent = MEAN + grid.field(coefficients)
        expected = self._other + self._live_s * self._signal(self.scale * softplus(latent))
        slope = (self.scale / (1.0 + np.exp(-latent))).astype(np.float32)
        jacobian = grid.projected(self._live_s[..., None] * (model.kernels.every * slope)).reshape(-1, grid.modes)
        weight = (model.weight / expected).ravel()
        weighted = jacobian * weight[:, None]
        fisher = weighted.T @ jacobian + np.diag(self._precision)
        score = weighted.T @ (model.counts - expected).ravel() - self._precision * coefficients
        step = cho_solve(cho_factor(fisher, lower=True), score)
        step *= min(1.0, _MAX_STEP / max(float(np.abs(grid.field(step)).max()), 1e-9))
        before = self._density(coefficients)
        for _ in range(4):
            after: Array = coefficients + step
            if self._density(after) >= before:
                return after
            step = 0.5 * step
        return coefficients
