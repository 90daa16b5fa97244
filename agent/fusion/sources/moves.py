"""Births, deaths and other moves of sources. Each compares a fit with others: one source more or less, another nuclide, a split.

A source is added where the log evidence gains ``least_gain``, and removed where it loses less than that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from radron.agent.fusion.sources.candidates import Scan
from radron.agent.fusion.sources.fit import Fitted, Problem
from radron.agent.fusion.sources.soil import Sight
from radron.agent.fusion.sources.solution import Solution
from radron.agent.fusion.sources.spectra import Spectra
from radron.agent.geometry import Array

_ITERATIONS = 12
_SHORT = 2  # iterations of a fit that only has to show whether it is worth more
_LEAST_COST = 6.0  # of log evidence, by which the volume of a further source's prior outweighs its likelihood at least
_NEARLY = 20.0  # of log likelihood, for which a joint or longer fit may compensate
_PROMISING = 2  # candidates fitted jointly with all else
_CERTAIN = 12.0  # sigmas of a source's log activity beyond which its death is not tried
_SPLIT_M = 1.3
_SPLIT_DIRECTIONS = 4
_MERGED_M = 8.0
_MOSTLY = 0.5  # of the photons of a source that would be counted in clear views
_NUISANCE_STEP = 0.3  # of its prior's sigma


@dataclass(frozen=True)
class Moves:
    """The moves on one problem. most: limit of the number of sources. least_gain: of log evidence, for a source more."""

    problem: Problem
    scan: Scan
    spectra: Spectra
    most: int
    least_gain: float

    def improved(self, solution: Solution, turn: int) -> Fitted:
        """Return the best fit that the moves find from a solution.

        ``turn``: chooses the source tried as another nuclide and as two; all others have their turn another time.
        """
        fitted = self.problem.fitted(solution, _ITERATIONS)
        fitted = self._with_nuisances(fitted)
        fitted = self._deaths(fitted)
        for _ in range(2 * self.most):
            grown = self._birth(fitted)
            if grown is None:
                break
            fitted = self._deaths(self._reshaped(self._with_nuisances(grown), len(grown.solution) - 1))
        if len(fitted.solution):
            fitted = self._merged(self._reshaped(fitted, turn % len(fitted.solution)))
        return fitted

    def anew(self, solution: Solution, kept: Solution, turn: int) -> Fitted:
        """Return the better fit: from ``kept``, a part of a solution, with moves; or from the whole solution, without moves."""
        return max(self.problem.fitted(solution, _ITERATIONS), self.improved(kept, turn), key=lambda one: one.evidence)

    def pruned(self, fitted: Fitted) -> Fitted:
        """Return the fit without the sources that the evidence does not support."""
        return self._deaths(fitted)

    def _with_nuisances(self, fitted: Fitted) -> Fitted:
        """Return the fit with better values of energy scale and scatter.

        Each is the top of a parabola through three values, or the better neighbour where there is no top.
        """
        if not len(fitted.solution):
            return fitted
        solution, value = fitted.solution, self.problem.value_of_counts(fitted.solution)
        for name in ("scale", "scatter"):
            step = _NUISANCE_STEP * getattr(self.problem.prior, name)
            at = getattr(solution, name)
            less, more = (self.problem.value_of_counts(replace(solution, **{name: at + k * step})) for k in (-1, 1))
            bend = less + more - 2.0 * value
            way = min(max(0.5 * (less - more) / bend, -2.0), 2.0) if bend < 0.0 else float(np.sign(more - less))
            moved = replace(solution, **{name: at + step * way})
            moved_value = self.problem.value_of_counts(moved)
            if moved_value > value:
                solution, value = moved, moved_value
        return fitted if solution is fitted.solution else self.problem.fitted(solution, _ITERATIONS)

    def _deaths(self, fitted: Fitted) -> Fitted:
        """Return the fit without the sources that the evidence does not support."""
        k = len(fitted.solution) - 1
        while k >= 0:
            if fitted.sigma_of(k)[2] * _CERTAIN > 1.0:
                enough = fitted.evidence - self.least_gain
                fewer = self.problem.fitted(fitted.solution.without(k), _SHORT)
                if fewer.evidence > enough - _NEARLY:
                    fewer = self.problem.fitted(fewer.solution, _ITERATIONS)
                fitted = fewer if fewer.evidence > enough else fitted
            k -= 1
        return fitted

    def _birth(self, fitted: Fitted) -> Fitted | None:
        """Return the fit with one more source; None if no candidate gains enough."""
        if len(fitted.solution) >= self.most:
            return None
        own = len(fitted.solution)
        others = self.problem.counts.expected(fitted.solution)
        before = self.problem.counts.log_likelihood(others)
        alone = []
        for one in self.scan.candidates(fitted.solution):
            grown, value = self.problem.fitted_alone(
                fitted.solution.plus(one.nuclide, one.place, one.log_activity, one.height), [own], others, _ITERATIONS
            )
            if value > before + self.least_gain + _LEAST_COST:
                alone.append((value, grown))
        alone.sort(key=lambda one: -one[0])
        for _, grown in alone[:_PROMISING]:
            found = self.problem.fitted(grown, _ITERATIONS)
            if found.evidence > fitted.evidence + self.least_gain:
                return found
        return None

    def _reshaped(self, fitted: Fitted, k: int) -> Fitted:
        """Return the fit with source k of another nuclide, or two sources in its place, if that is better."""
        best = self._mirrored(self._swapped(self._in_sight(fitted, k), k), k)
        if len(best.solution) < self.most:
            own, others = [k, len(best.solution)], self.problem.counts.expected(best.solution.without(k))
            pairs = [self.problem.fitted_alone(one, own, others, _ITERATIONS) for one in _split(best.solution, k)]
            pair, value = max(pairs, key=lambda one: one[1])
            alone = self.problem.counts.log_likelihood(self.problem.counts.expected(best.solution))
            if value > alone + self.least_gain + _LEAST_COST:
                joint = self.problem.fitted(pair, _ITERATIONS)
                best = joint if joint.evidence > best.evidence + self.least_gain else best
        return best

    def _in_sight(self, fitted: Fitted, k: int) -> Fitted:
        """Return the fit with source k only as strong as its counts in a clear view require, if that is better.

        A source that was found too strong seems hidden wherever it counts, and nothing makes it weaker then.
        """
        counts, solution = self.problem.counts, fitted.solution
        expected = counts.expected(solution)
        own, hidden = counts.of_source(solution, k).sum(axis=1), counts.views(expected).hidden
        if own @ hidden < _MOSTLY * own.sum():
            return fitted
        seen = float((counts.counts - expected.clear).sum(axis=1) @ hidden + own @ hidden)
        activity = solution.log_activity.copy()
        activity[k] += np.log(max(seen, 1.0) / (own @ hidden))
        weaker = self.problem.fitted(replace(solution, log_activity=activity), _ITERATIONS)
        return weaker if weaker.evidence > fitted.evidence else fitted

    def _swapped(self, fitted: Fitted, k: int) -> Fitted:
        """Return the fit with source k of the nuclide that explains the counts best, all else unchanged, if that is better."""
        sums = self.spectra.areas(0.0, 0.0, Sight()).sum(axis=1)
        solution, own = fitted.solution, fitted.solution.nuclide[k]
        rest, others = self.problem.counts.expected(solution.without(k)), []
        for n in range(len(sums)):
            if n != own:
                activity = solution.log_activity.copy()
                activity[k] += float(np.log(sums[own] / sums[n]))
                nuclide = tuple(n if i == k else m for i, m in enumerate(solution.nuclide))
                other = replace(solution, nuclide=nuclide, log_activity=activity)
                others.append(self.problem.fitted_alone(other, [k], rest, _SHORT))
        if not others:
            return fitted
        best, value = max(others, key=lambda one: one[1])
        alone = self.problem.counts.log_likelihood(self.problem.counts.expected(solution))
        if value < alone - _NEARLY:
            return fitted
        swapped = self.problem.fitted(best, _ITERATIONS)
        return swapped if swapped.evidence > fitted.evidence else fitted

    def _mirrored(self, fitted: Fitted, k: int) -> Fitted:
        """Return the fit with the height of source k mirrored at the height of its main cameras, if that is better.

        From one height, the counts of both heights are the same.
        """
        height = fitted.solution.height
        if height is None:
            return fitted
        mirrored = height.copy()
        mirrored[k] = 2.0 * self.problem.counts.camera_height_m(fitted.solution.place[k]) - height[k]
        if not self.problem.prior.height[0] <= mirrored[k] <= self.problem.prior.height[1]:
            return fitted
        other = self.problem.fitted(replace(fitted.solution, height=mirrored), _ITERATIONS)
        return other if other.evidence > fitted.evidence else fitted

    def _merged(self, fitted: Fitted) -> Fitted:
        """Return the fit with one source in the place of two near each other, wherever that is no worse."""
        for first in range(len(fitted.solution)):
            for second in range(first + 1, len(fitted.solution)):
                one = _joined(fitted.solution, first, second)
                if one is None:
                    continue
                merged = self.problem.fitted(one, _ITERATIONS)
                if merged.evidence > fitted.evidence - self.least_gain:
                    return merged
        return fitted


def _split(solution: Solution, k: int) -> list[Solution]:
    """Return solutions with two sources of half the activity on either side of source k, in a few directions."""
    pairs = []
    for direction in range(_SPLIT_DIRECTIONS):
        angle = np.pi * direction / _SPLIT_DIRECTIONS
        off: Array = _SPLIT_M * np.array([np.cos(angle), np.sin(angle)])
        place, activity = solution.place.copy(), solution.log_activity.copy()
        place[k] += off
        activity[k] -= np.log(2.0)
        moved = replace(solution, place=place, log_activity=activity)
        pairs.append(moved.plus(solution.nuclide[k], solution.place[k] - off, float(activity[k]), solution.height_of(k)))
    return pairs


def _joined(solution: Solution, first: int, second: int) -> Solution | None:
    """Return the solution with two sources of one nuclide joined at their activity-weighted mean; None if too far apart."""
    both = [first, second]
    away = solution.place[first] - solution.place[second]
    if solution.nuclide[first] != solution.nuclide[second] or float(away @ away) > _MERGED_M**2:
        return None
    strength = np.exp(solution.log_activity[both])
    share = strength / strength.sum()
    place, activity = solution.place.copy(), solution.log_activity.copy()
    place[first], activity[first] = share @ place[both], float(np.log(strength.sum()))
    height = solution.height
    if height is not None:
        height = height.copy()
        height[first] = share @ height[both]
    return replace(solution, place=place, log_activity=activity, height=height).without(second)
