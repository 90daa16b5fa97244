"""Fits of contaminated ground by Fisher scoring, with Laplace's evidence.

With J the derivatives of the expectations lambda, w the sums' weights and P the prior's precision, a step solves

    H (theta' - theta) = J' w (y - lambda) / lambda - P theta,    H = J' diag(w / lambda) J + P,

and the log evidence of a fit at its maximum is [TK86]

    ln p(y) = l - theta' P theta / 2 - ln|H| / 2 + ln|P| / 2.

Scatter and drones' errors are zero in a fit, and count in its covariance and evidence alone: fitted together with the activity
they blur its edges. Scale and length of the ground's prior are those of the greatest evidence on a grid, by the quadratic
approximation of l at the last step: then a pair costs one factorisation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.ndimage import gaussian_filter

from radron.agent.fusion.field.model import CountModel, Priors, Solution
from radron.agent.geometry import Array

SCALES: Final = tuple(10.0 ** (0.5 * power) for power in range(6, 17))  # Bq/m2
LENGTHS_M: Final = (8.0, 14.0, 25.0)
_MAX_BACKGROUND_STEP: Final = 1.0  # of the background's logarithm
_HALVINGS: Final = 4


@dataclass(frozen=True, eq=False)
class Smoothness:
    """Prior of the ground's activity per area: 1 sigma in Bq/m2, and correlation length."""

    scale: float
    length_m: float


MEAN_BQM2: Final = 1e6
ROUGH: Final = 3.0  # scale relative to a shape
SHAPE_FLOOR: Final = 0.05  # of its highest value
_SMOOTHED: Final = 1.5  # cells
FLAT: Final = Smoothness(1e6, 14.0)


@dataclass(frozen=True, eq=False)
class Fitted:
    """A fit at its maximum. covariance: of the solution's vector, widened by the errors that are zero in the fit.
    evidence: ln p(y), up to a constant of the data.
    """

    solution: Solution
    smoothness: Smoothness
    covariance: Array
    evidence: float


class Problem:
    """Fits to the sums of one model."""

    def __init__(self, model: CountModel, priors: Priors, mean: float = MEAN_BQM2) -> None:
        """mean: prior 1 sigma of the mean activity, and of that beyond the grid, Bq/m2; so wide that the counts decide."""
        self.model, self._priors, self._mean = model, priors, mean
        modes = model.grid.modes
        beyond = float(model.amplitude.max()) ** 2
        self._spectra = {length: np.append(model.grid.spectrum(length), beyond) for length in LENGTHS_M}
        self._modes = modes

    def shaped(self, activity: Array) -> Problem:
        """Return the problem with a prior of the shape of a map (N,) Bq/m2, smoothed over ``_SMOOTHED`` cells, and a floor."""
        grid = self.model.grid
        smooth = gaussian_filter(activity.reshape(grid.rows, grid.columns), _SMOOTHED).ravel()
        return Problem(self.model.shaped(smooth + SHAPE_FLOOR * smooth.max()), self._priors, 0.0)

    @property
    def rough(self) -> Smoothness:
        """A prior that hardly smooths a shape: with it blocks at edges have honest intervals."""
        return Smoothness(ROUGH, LENGTHS_M[0])

    def with_ground(self, solution: Solution) -> Solution:
        """Return the solution with a contaminated area, of no activity yet."""
        return replace(solution, ground=np.zeros(self._modes + 1))

    def fitted(self, start: Solution, iterations: int, smoothness: Smoothness | None = None, choices: int = 3) -> Fitted:
        """Return the fit that begins with a solution. ``smoothness``: None: chosen at the first ``choices`` steps."""
        solution, now = start, smoothness or FLAT
        for iteration in range(iterations):
            fisher, pull = self._normal(solution)
            if smoothness is None and len(solution.ground) and iteration < choices:
                now = self._chosen(solution, fisher, pull, now)
            solution = self._stepped(solution, fisher, pull, now)
        return self._judged(solution, now)

    def _normal(self, solution: Solution) -> tuple[Array, Array]:
        """Return J' W J and J' W (y - lambda + J theta) at a solution."""
        model = self.model
        expected, jacobian = model.expected(solution), model.jacobian(solution)
        weight = (model.weight / expected).ravel()
        weighted = jacobian * weight[:, None]
        fisher = weighted.T @ jacobian
        pull = weighted.T @ (model.counts - expected).ravel() + fisher @ solution.vector
        return fisher, pull

    def precision(self, solution: Solution, smoothness: Smoothness) -> Array:
        """Return the prior's precision of a solution's vector."""
        variance = smoothness.scale**2 * self._spectra[smoothness.length_m]
        variance[[0, -1]] += self._mean**2  # of the grid, and of the ground beyond
        return self._priors.precision(solution, 1.0 / variance)

    def _chosen(self, solution: Solution, fisher: Array, pull: Array, now: Smoothness) -> Smoothness:
        """Return scale and length with the greatest evidence: scales in decades first, then all neighbours."""
        coarse = [Smoothness(scale, now.length_m) for scale in SCALES[::2]]
        best = max(coarse, key=lambda one: self._approximate(solution, fisher, pull, one))
        place = SCALES.index(best.scale)
        near = SCALES[max(place - 1, 0) : place + 2]
        return max(
            (Smoothness(scale, length) for scale in near for length in LENGTHS_M),
            key=lambda one: self._approximate(solution, fisher, pull, one),
        )

    def _approximate(self, solution: Solution, fisher: Array, pull: Array, smoothness: Smoothness) -> float:
        """Return the log evidence up to a constant."""
        precision = self.precision(solution, smoothness)
        factor = cho_factor(fisher + precision, lower=True)
        mean = cho_solve(factor, pull)
        ground = slice(0, len(solution.ground))
        prior = np.log(np.diag(precision)[ground]).sum()
        return float(0.5 * pull @ mean - np.log(np.diag(factor[0])).sum() + 0.5 * prior)

    def _stepped(self, solution: Solution, fisher: Array, pull: Array, smoothness: Smoothness) -> Solution:
        """Return the solution after a step, halved until the posterior density rises; the solution itself if it does not."""
        precision = self.precision(solution, smoothness)
        here = solution.vector
        factor = cho_factor(fisher + precision, lower=True)
        step = _limited(cho_solve(factor, pull) - here, solution)
        before = self._density(solution, precision)
        for _ in range(_HALVINGS):
            after = solution.moved(here + step)
            if self._density(after, precision) >= before:
                return after
            step = 0.5 * step
        return solution

    def _density(self, solution: Solution, precision: Array) -> float:
        vector = solution.vector
        return self.model.log_likelihood(self.model.expected(solution)) - 0.5 * float(vector @ precision @ vector)

    def _judged(self, solution: Solution, smoothness: Smoothness) -> Fitted:
        """Return the fit at its maximum, with the errors that are zero in it."""
        model, priors = self.model, self._priors
        precision, of_errors = self.precision(solution, smoothness), priors.of_errors
        weight = (model.weight / model.expected(solution)).ravel()
        jacobian = np.hstack((model.jacobian(solution), model.by_errors(solution, len(priors.place_m))))
        factor = cho_factor((jacobian * weight[:, None]).T @ jacobian + block_diag(precision, np.diag(of_errors)), lower=True)
        fitted = len(precision)
        covariance = cho_solve(factor, np.eye(len(factor[0]))[:, :fitted])[:fitted]
        evidence = self._density(solution, precision) - float(np.log(np.diag(factor[0])).sum())
        evidence += 0.5 * float(np.linalg.slogdet(precision)[1] + np.log(of_errors).sum())
        if len(solution.ground):
            evidence -= math.log(len(SCALES) * len(LENGTHS_M))
        return Fitted(solution, smoothness, covariance, evidence)


def _limited(step: Array, solution: Solution) -> Array:
    """Return the step with a limited step of the background, whose logarithm is fitted."""
    own = slice(len(solution.ground), None)
    result = step.copy()
    result[own] = np.clip(step[own], -_MAX_BACKGROUND_STEP, _MAX_BACKGROUND_STEP)
    return result


def total(fitted: Fitted, weights: Sequence[Array] | Array) -> tuple[Array, Array]:
    """Return mean (B,) and covariance (B, B) of linear functions (B, K) of the ground's numbers."""
    table = np.asarray(weights)
    ground = slice(0, len(fitted.solution.ground))
    covariance: Array = table @ fitted.covariance[ground, ground] @ table.T
    return table @ fitted.solution.ground, covariance
