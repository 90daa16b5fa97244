"""The joint fit of sources and nuisances by Fisher scoring, and the evidence of the fit by Laplace's method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from radron.agent.fusion.sources.counts import CountModel, Derivatives
from radron.agent.fusion.sources.directions import ConeModel
from radron.agent.fusion.sources.hidden import Expected
from radron.agent.fusion.sources.soil import SOIL_SIGMA
from radron.agent.fusion.sources.solution import BIAS, Solution
from radron.agent.geometry import Array

_MOST_STEP = np.array([2.0, 2.0, 1.0, 2.0])  # limit of one iteration, by number of a source
_DAMPINGS = (0.0, 0.1, 1.0, 10.0, 100.0)  # Levenberg and Marquardt's, tried in turn until the fit improves
_CONVERGED = 2e-3  # of the next iteration's promised improvement


@dataclass(frozen=True)
class Prior:
    """1-sigma errors of the nuisances, and limits of the sources' places and activities.

    bias: (V, BIAS) of the drones. background, scale, scatter: of the nuisances of those names; soil: (2,) of ``Solution.soil``.
    low, high: (2,) corners of the region of sources, metres. log_activity: least and greatest. area_m2: of the region. expected:
    number of sources expected. height: least and greatest above the ground, metres.
    """

    bias: Array
    background: float
    scale: float
    scatter: float
    low: Array
    high: Array
    log_activity: tuple[float, float]
    area_m2: float
    expected: float
    height: tuple[float, float] = (0.0, 0.0)
    soil: tuple[float, float] = SOIL_SIGMA

    def log_density(self, solution: Solution) -> float:
        """Return the log density of the nuisances, up to a constant."""
        squares = float(((solution.bias / self.bias) ** 2).sum()) + (solution.log_background / self.background) ** 2
        squares += float(((solution.soil / self._soil(solution)) ** 2).sum())
        return -0.5 * (squares + (solution.scale / self.scale) ** 2 + (solution.scatter / self.scatter) ** 2)

    def precision(self, solution: Solution) -> Array:
        """Return the (d,) precisions of ``Solution.vector``; a source's are of uniform distributions of the same variance."""
        least, greatest = self.log_activity
        source = [12.0 / self.area_m2, 12.0 / self.area_m2, 12.0 / (greatest - least) ** 2]
        if solution.height is not None:
            source.append(12.0 / (self.height[1] - self.height[0]) ** 2)
        around = [self.background**-2], self._soil(solution) ** -2.0
        return np.concatenate((source * len(solution), *around, (self.bias**-2.0).ravel()))

    def _soil(self, solution: Solution) -> Array:
        return np.array(self.soil[: len(solution.soil)])

    def inside(self, solution: Solution) -> Solution:
        """Return the solution with all sources within the limits."""
        place = np.minimum(np.maximum(solution.place, self.low), self.high)
        activity = np.clip(solution.log_activity, *self.log_activity)
        height = None if solution.height is None else np.clip(solution.height, *self.height)
        return replace(solution, place=place, log_activity=activity, height=height)


class Fitted(Struct, frozen=True, eq=False):
    """A solution with log posterior density, its covariance (d, d) in the order of ``Solution.vector``, and log evidence."""

    solution: Solution
    value: float
    covariance: Array
    evidence: float

    def sigma_of(self, k: int) -> Array:
        """Return the 1-sigma errors of x, y (m), log activity and, with a height among the numbers, height (m) of source k."""
        size = self.solution.size
        result: Array = np.sqrt(np.diag(self.covariance)[size * k : size * (k + 1)])
        return result


class Problem:
    """The likelihoods of counts and cones with the prior: the measure of solutions."""

    def __init__(self, counts: CountModel, cones: ConeModel, prior: Prior, candidates: int) -> None:
        """``candidates``: number of nuclides that a source may be of."""
        self.counts, self.cones, self.prior = counts, cones, prior
        self._candidates = candidates

    def value(self, solution: Solution) -> float:
        """Return the log posterior density, up to a constant."""
        return self.value_of_counts(solution) + self.cones.log_likelihood(solution)

    def value_of_counts(self, solution: Solution) -> float:
        """Return ``value`` without the cones, which do not depend on energy scale and scatter."""
        return self.counts.log_likelihood(self.counts.expected(solution)) + self.prior.log_density(solution)

    def fitted(self, solution: Solution, iterations: int) -> Fitted:
        """Return the best solution near the given one, after at most so many iterations."""
        solution = self.prior.inside(solution)
        value, derivatives = self._scored(solution)
        gradient, information = derivatives()
        for _ in range(iterations):
            found = self._better(solution, value, gradient, information)
            if found is None:
                break
            promised = found[1] - value
            solution, value, gradient, information = found
            if promised < _CONVERGED:
                break
        return self._judged(solution, value, information)

    def fitted_alone(
        self, solution: Solution, sources: Sequence[int], others: Expected, iterations: int
    ) -> tuple[Solution, float]:
        """Return the best solution near the given one with only these sources changed, and its log likelihood of the counts.

        ``others``: expected counts without these sources.
        """
        solution = self.prior.inside(solution)
        numbers = [solution.size * k + part for k in sources for part in range(solution.size)]
        prior = np.diag(self.prior.precision(solution)[numbers])
        value, derivatives = self.counts.scored_alone(solution, sources, others)
        for _ in range(iterations):
            gradient, information = derivatives()
            vector = solution.vector
            vector[numbers] += _limited(solved(information + prior, gradient), len(sources), solution.size)
            new = self.prior.inside(solution.moved(vector))
            scored = self.counts.scored_alone(new, sources, others)
            if not scored[0] >= value + _CONVERGED:  # true for NaN too
                break
            solution, (value, derivatives) = new, scored
        return solution, value

    def _better(
        self, solution: Solution, value: float, gradient: Array, information: Array
    ) -> tuple[Solution, float, Array, Array] | None:
        """Return the next solution, scored; None if no damping improves the value."""
        diagonal = np.diag(np.diag(information))
        for damping in _DAMPINGS:
            step = solved(information + damping * diagonal, gradient)
            if float(gradient @ step) < _CONVERGED:
                return None
            new = self.prior.inside(solution.moved(solution.vector + _limited(step, len(solution), solution.size)))
            better, derivatives = self._scored(new)
            if better > value:
                return new, better, *derivatives()
        return None

    def _scored(self, solution: Solution) -> tuple[float, Derivatives]:
        """Return log posterior density; gradient (d,) and information (d, d), in the order of ``Solution.vector``."""
        value, of_counts = self.counts.scored(solution)
        cone_value, of_cones = self.cones.scored(solution)
        value += cone_value + self.prior.log_density(solution)
        return value, lambda: self._joint(solution, of_counts(), of_cones())

    def _joint(self, solution: Solution, *by_drone: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return gradient and information of the posterior density, from the likelihoods' parts by drone."""
        gradients, informations = (sum(part) for part in zip(*by_drone, strict=True))
        precision = self.prior.precision(solution)
        count, free = solution.unbiased, solution.of_sources  # the priors of the sources' numbers are uniform
        gradient = np.zeros(len(precision))
        information = np.diag(precision)
        gradient[free:] -= (precision * solution.vector)[free:]
        shift = by_bias(solution)
        for drone, (g, h) in enumerate(zip(gradients, informations, strict=True)):
            own = slice(count + BIAS * drone, count + BIAS * (drone + 1))
            gradient[:count] += g
            gradient[own] += shift.T @ g
            information[:count, :count] += h
            information[:count, own] += h @ shift
            information[own, :count] += shift.T @ h
            information[own, own] += shift.T @ h @ shift
        return gradient, information

    def _judged(self, solution: Solution, value: float, information: Array) -> Fitted:
        """Return the fit with covariance and evidence: of K sources, relative to the same nuisances without sources,

        value + K log(expected / candidates) + 1/2 log |prior's information| - 1/2 log |information|.
        """
        precision = self.prior.precision(solution)
        _, logarithm = np.linalg.slogdet(information)
        occam = 0.5 * (float(np.log(precision).sum()) - float(logarithm))
        prior = len(solution) * float(np.log(self.prior.expected / self._candidates))
        covariance = np.asarray(np.linalg.inv(information), np.float64)
        return Fitted(solution, value, covariance, value + prior + occam)


def solved(matrix: Array, right: Array) -> Array:
    """Return matrix^-1 right."""
    return np.asarray(np.linalg.solve(matrix, right), np.float64)


def by_bias(solution: Solution) -> Array:
    """Return the (unbiased, BIAS) effect of a drone's bias. A position bias shifts all sources in the drone's view; the
    sensitivity scales them and the background.
    """
    size = solution.size
    shift = np.zeros((solution.unbiased, BIAS))
    for k in range(len(solution)):
        shift[size * k : size * (k + 1)] = np.eye(size, BIAS)
    shift[solution.of_sources, 2] = 1.0
    return shift


def _limited(step: Array, sources: int, size: int) -> Array:
    """Limit the step of each source by itself, so that no source moves or changes too far at once."""
    each = step[: size * sources].reshape(-1, size)
    excess = np.maximum((np.abs(each) / _MOST_STEP[:size]).max(axis=1, initial=0.0), 1.0)
    return np.concatenate(((each / excess[:, None]).ravel(), step[size * sources :]))
