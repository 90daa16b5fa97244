"""Sources of nuclides that are not among the candidates: their spectrum is not explained by any candidate.

The spectrum beside a source is measured bin by bin, without a model of it. S (BINS,) are the areas of a point source at its place
that explain the counts, less the other sources and the background,

    M_re = others_re + w_r S_e.

S is compared with the best spectrum of one candidate, or of two at one place. Energy scale and excess of scatter, over soil the
strength and composition of its scatter, are free within reason. The misfit is chi squared. Its errors are by chance in S, by the
other sources, by the tables (the share ``_MODEL_ERROR``), and by the different energy scales of cameras. A misfit above
``_MOST_MISFIT`` is explained neither by errors of the model nor by chance. Then a source with the spectrum S replaces the source,
and the sources beside it that only compensated for its spectrum. This source has a place and lines, but no activity: its photons
per decay are unknown.

Other sources, too, may have compensated for the wrong spectrum. So the next moves begin with the sources of unknown nuclides
alone. Their result is compared with the former fit: one search a step, not two.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from msgspec.structs import replace
from scipy.ndimage import maximum_filter1d

from radron.agent.fusion.facing import MEAN_STEEPNESS
from radron.agent.fusion.sources.fit import Fitted, Prior, Problem
from radron.agent.fusion.sources.soil import AS_TABULATED, Sight
from radron.agent.fusion.sources.solution import Solution
from radron.agent.fusion.sources.spectra import NEAREST_M, PER_MM2, UNKNOWN_AIR_PER_M, Spectra, UnknownSpectrum
from radron.agent.geometry import Array
from radron.protocol.spectrum import BINS, EDGES_KEV

_MODEL_ERROR = 0.05  # relative, of each bin
_OTHERS_ERROR = 0.1  # of the counts of other sources and the background
_CAMERA_SCALE = 0.01  # differences between the energy scales of cameras
_MOST_MISFIT, _EXPLAINED = 80.0, 40.0  # chi squared of 32 bins: of known nuclides; and of unknown ones that are known by now
_REACH_M = 15.0  # reach of the measurement of a source's spectrum
_TOGETHER_M = 3.0  # within which other sources may only compensate for the spectrum of one
_SCALES, _SCATTERS = np.linspace(-2.0, 2.0, 17), (0.0, -2.0, 2.0)  # sigmas of their priors
_SOILS = (0.0, -0.5, 0.5, -1.0, 1.0, -1.5, 1.5, -2.0, 2.0)  # likewise, of soil's scatter, most of the counts
_NEAREST_FIRST = np.argsort(np.abs(_SCALES), kind="stable")  # most spectra are explained without much of either
_WITHIN = 2.0  # of their priors' sigmas: farther off, the nuisances compensate for a wrong spectrum
_AROUND = 5  # bins
_UPDATES = 8  # of S
_ITERATIONS = 12
_SETTLING = 2  # rounds of the spectrum and the place
_LINE_LEFT, _LINE_SIGMAS = 0.6, 5.0  # of a line's peak: most that is left within two bins on both sides, least height above that
_EDGES_KEV = np.array(EDGES_KEV)
_TINY = 1e-12


@dataclass(frozen=True, eq=False)
class Measured:
    """A measured spectrum. area: S; chance: its statistical errors; taken: subtracted counts of the other sources and the
    background; (BINS,) each, mm2 of a source of REFERENCE_BQ. distance_m, facing, steepness: means, see ``spectra``.
    """

    area: Array
    chance: Array
    taken: Array
    distance_m: float
    facing: float
    steepness: float = MEAN_STEEPNESS

    def variance(self, expected: Array) -> Array:
        """Return the variance of S (..., BINS), given its expectation.

        Two parts: chance, of the expected counts wherever they exceed the counted ones; and errors of the subtracted counts.
        """
        more = (self.taken + np.maximum(self.area, expected)) / (self.taken + self.area)
        result: Array = self.chance**2 * more + (_OTHERS_ERROR * self.taken) ** 2
        return result

    @property
    def sigma(self) -> Array:
        """1 sigma of S, from the counts."""
        return np.sqrt(self.variance(self.area))


@dataclass(frozen=True)
class Explanation:
    """The candidates, one or two, that explain a spectrum best, with their activities. misfit: chi squared."""

    nuclides: tuple[int, ...]
    activity: tuple[float, ...]
    misfit: float


def judged(fitted: Fitted, spectra: Spectra, problem_of: Callable[[Spectra], Problem]) -> tuple[Fitted, Spectra]:
    """Return the fit with one source exchanged between known and unknown nuclides, and the spectra with the fit's unknown
    nuclides.

    The source with the greatest misfit is replaced by a source of an unknown nuclide, if candidates do not explain it. Or a
    source of an unknown nuclide is replaced by the candidates that explain it by now. ``problem_of``: the problem of the same
    measurements with given spectra; ``spectra`` are the fit's. Without a change, the same objects are returned.
    """
    problem, worst = problem_of(spectra), _MOST_MISFIT
    likely = _likely(fitted.solution, problem.prior)
    information = problem.counts.views(problem.counts.expected(likely)).information
    changed: tuple[Solution, Spectra] | None = None
    for group in _groups(fitted.solution):
        measured = measured_at(problem, likely, group, information)
        if measured is None:
            continue
        unknown = any(spectra.name_of(fitted.solution.nuclide[k]) is None for k in group)
        best = explained(measured, spectra, problem.prior, 0.0 if unknown else worst)
        if best.misfit < _EXPLAINED and unknown:
            return problem.fitted(_with(fitted.solution, group, best.nuclides, best.activity), _ITERATIONS), spectra
        if best.misfit > worst and (not unknown or len(group) > 1):
            worst = best.misfit
            changed = _unknown(likely, group, spectra, measured)
    if changed is None:
        return fitted, spectra
    return settled(*changed, problem_of)


def settled(solution: Solution, spectra: Spectra, problem_of: Callable[[Spectra], Problem]) -> tuple[Fitted, Spectra]:
    """Return the fit with the spectra of its unknown nuclides measured in turn with the sources' places."""
    problem = problem_of(spectra)
    fitted = problem.fitted(solution, _ITERATIONS)
    for _ in range(_SETTLING):
        solution = fitted.solution
        information = problem.counts.views(problem.counts.expected(solution)).information
        for k, n in enumerate(fitted.solution.nuclide):
            measured = measured_at(problem, fitted.solution, (k,), information) if spectra.name_of(n) is None else None
            if measured is not None:
                solution, spectra = _unknown(solution, (k,), spectra, measured)
        problem = problem_of(spectra)
        fitted = problem.fitted(solution, _ITERATIONS)
    return fitted, spectra


def only_told(fitted: Fitted, spectra: Spectra) -> tuple[Fitted, Spectra]:
    """Return fit and spectra with the unknown nuclides limited to the fitted sources'."""
    known = len(spectra.nuclides)
    told = sorted({n for n in fitted.solution.nuclide if n >= known})
    if len(told) == len(spectra.unknown):
        return fitted, spectra
    number = {n: known + place for place, n in enumerate(told)}
    nuclide = tuple(number.get(n, n) for n in fitted.solution.nuclide)
    kept = Spectra.of(spectra.nuclides, spectra.ground).plus([spectra.unknown[n - known] for n in told])
    return replace(fitted, solution=replace(fitted.solution, nuclide=nuclide)), kept


def only_unknown(solution: Solution, spectra: Spectra) -> Solution:
    """Return the sources of unknown nuclides alone: the others may have compensated for a wrong spectrum."""
    return solution.only([k for k, n in enumerate(solution.nuclide) if spectra.name_of(n) is None])


def measured_at(problem: Problem, solution: Solution, group: Sequence[int], information: Array) -> Measured | None:
    """Return the spectrum of all sources of a group, at the place of its first source; None where too little was measured.

    ``information``: (R,) of the views of the solution.
    """
    counts = problem.counts
    distance, facing, steepness, live = counts.aside(solution, group[0])
    near = distance < _REACH_M
    if not near.any():
        return None
    others = counts.expected(solution.only([k for k in range(len(solution)) if k not in group])).clear[near]
    weight = information[near, None]
    distance, facing, steepness = np.maximum(distance[near], NEAREST_M), facing[near], steepness[near]
    w = (PER_MM2 * live[near] * np.exp(-UNKNOWN_AIR_PER_M * distance) / distance**2)[:, None]
    seen = counts.counts[near]
    area = np.maximum(((weight * w * (seen - others) / others).sum(axis=0)) / (weight * w * w / others).sum(axis=0), _TINY)
    for _ in range(_UPDATES):
        expected = others + w * area
        precision = weight * w * w / expected
        area = np.maximum(area + (weight * w * (seen / expected - 1.0)).sum(axis=0) / precision.sum(axis=0), _TINY)
    share = precision @ area**2
    share /= share.sum()
    taken = (precision * others / w).sum(axis=0) / precision.sum(axis=0)
    means = [float(share @ part) for part in (distance, facing, steepness)]
    return Measured(area, precision.sum(axis=0) ** -0.5, taken, *means)


def explained(measured: Measured, spectra: Spectra, prior: Prior, enough: float = 0.0) -> Explanation:
    """Return the best of all pairs of candidates and single ones; or the first with at most the misfit ``enough``."""
    each = _explanations(measured, spectra, prior)
    best = next(each)
    while best.misfit > enough and (other := next(each, None)) is not None:
        best = min(best, other, key=lambda one: one.misfit)
    return best


def _explanations(measured: Measured, spectra: Spectra, prior: Prior) -> Iterator[Explanation]:
    """Yield the best explanation for each energy scale and excess of scatter, over soil for each strength of its scatter."""
    known = slice(0, len(spectra.nuclides))
    pairs = np.array(list(combinations_with_replacement(range(len(spectra.nuclides)), 2)))
    highest = maximum_filter1d(measured.area, _AROUND)  # an empty bin by chance must not decide
    variance = measured.variance(highest) + (_MODEL_ERROR * measured.area) ** 2
    for off in _SCATTERS if spectra.soil is None else _SOILS:
        shapes, others = (part[:, known] for part in _by_scale(measured, spectra, prior, off))
        by_scale = np.gradient(shapes, prior.scale * _SCALES, axis=0)
        for place in _NEAREST_FIRST.tolist():
            scale, parts = float(_SCALES[place]), (shapes[place], by_scale[place], others[place] - shapes[place])
            activity = _activities(shapes[place], pairs, measured.area, 1.0 / variance)
            model, change, softer = (np.einsum("pi,pib->pb", activity, part[pairs]) for part in parts)
            allowed = (
                measured.variance(model) + (_MODEL_ERROR * np.maximum(measured.area, model)) ** 2 + (_CAMERA_SCALE * change) ** 2
            )
            misfit = _with_composition(measured.area - model, softer, allowed)
            best = int(misfit.argmin())
            used = [(int(n), float(a)) for n, a in zip(pairs[best], activity[best], strict=True) if a > 0.0]
            nuclides, activities = tuple(n for n, _ in used), tuple(a for _, a in used)
            yield Explanation(nuclides, activities, float(misfit[best]) + scale**2 + off**2)


def _by_scale(measured: Measured, spectra: Spectra, prior: Prior, off: float) -> tuple[Array, Array]:
    """Return ``_seen`` (SCALES, N + U, BINS) by energy scale, and the same with a composition of the ground of 1 sigma.

    off: sigmas of the strength of the soil's scatter, over nothing of the excess of scatter.
    """
    scales = (prior.scale * _SCALES).tolist()
    if spectra.soil is None:
        bare = np.stack([_seen(measured, spectra, scale, prior.scatter * off) for scale in scales])
        return bare, bare
    strength, composition = prior.soil
    soils = np.array([(strength * off, 0.0), (strength * off, composition)])
    soil, other = (np.stack([_seen(measured, spectra, scale, 0.0, each) for scale in scales]) for each in soils)
    return soil, other


def _with_composition(off: Array, softer: Array, variance: Array) -> Array:
    """Return (P,) chi squared of residuals (P, BINS), with the best composition of the ground, to first order, within its limits.

    softer: (P, BINS) change of the model by 1 sigma of the composition; 0 over nothing.
    """
    towards, curvature = (off * softer / variance).sum(axis=1), 1.0 + (softer * softer / variance).sum(axis=1)
    best = np.clip(towards / curvature, -_WITHIN, _WITHIN)
    result: Array = (off**2 / variance).sum(axis=1) - best * (2.0 * towards - best * curvature)
    return result


def _seen(measured: Measured, spectra: Spectra, scale: float, scatter: float, soil: Array = AS_TABULATED) -> Array:
    """Return (N + U, BINS) areas of all nuclides, as measured with the attenuation of unknown nuclides."""
    air = spectra.air_per_m[:, None] * measured.distance_m
    seen = spectra.areas(scale, scatter, Sight(air, measured.facing, measured.steepness), soil)
    return np.maximum(seen, 0.0) * np.exp(UNKNOWN_AIR_PER_M * measured.distance_m - air)


def _activities(shapes: Array, pairs: Array, area: Array, precision: Array) -> Array:
    """Return (P, 2) activities of the pairs (P, 2), by least squares.

    A single nuclide's activity is returned where the other's would be negative, or where both are the same.
    """
    products, right = (shapes * precision) @ shapes.T, (shapes * precision) @ area
    first, second = pairs.T
    alone: Array = np.maximum(right / np.diag(products), _TINY)
    determinant = products[first, first] * products[second, second] - products[first, second] ** 2
    safe = np.where(first == second, 1.0, determinant)
    one = (right[first] * products[second, second] - right[second] * products[first, second]) / safe
    other = (right[second] * products[first, first] - right[first] * products[first, second]) / safe
    both = (one > 0.0) & (other > 0.0) & (first != second)
    return np.column_stack((np.where(both, one, alone[first]), np.where(both, other, 0.0)))


def lines_kev(measured: Measured) -> tuple[int, ...]:
    """Return energies (keV, ascending) of the peaks that stand out of their surroundings, to about half a bin: 7 to 35 keV."""
    area, middle = np.pad(measured.area, 2), np.pad(0.5 * (_EDGES_KEV[1:] + _EDGES_KEV[:-1]), 2)
    found = []
    for e in range(2, BINS + 2):
        beside = float(max(area[e - 2 : e].min(), area[e + 1 : e + 3].min()))
        apex = area[e - 1] <= area[e] > area[e + 1]
        if apex and beside < _LINE_LEFT * area[e] and area[e] - beside > _LINE_SIGMAS * measured.sigma[e - 2]:
            above = np.maximum(area[e - 1 : e + 2] - beside, 0.0)
            found.append(round(float(above @ middle[e - 1 : e + 2] / above.sum())))
    return tuple(found)


def _unknown(solution: Solution, group: Sequence[int], spectra: Spectra, measured: Measured) -> tuple[Solution, Spectra]:
    """Return the solution with one source of a new unknown nuclide in the place of a group, and the extended spectra."""
    sight = Sight(UNKNOWN_AIR_PER_M * measured.distance_m, measured.facing, measured.steepness)
    spectrum = UnknownSpectrum.measured(measured.area, sight, lines_kev(measured), solution.soil)
    extended = spectra.plus([spectrum])
    activity = float(measured.area.sum() / _seen(measured, extended, 0.0, 0.0, solution.soil)[-1].sum())
    return _with(solution, group, (len(extended.air_per_m) - 1,), (activity,)), extended


def _with(solution: Solution, group: Sequence[int], nuclides: Sequence[int], activity: Sequence[float]) -> Solution:
    """Return the solution with sources of these nuclides in the place of a group; the first takes the group's first index."""
    first = group[0]
    place, height = solution.place[first], solution.height_of(first)
    nuclide = tuple(nuclides[0] if k == first else n for k, n in enumerate(solution.nuclide))
    activities = solution.log_activity.copy()
    activities[first] = np.log(activity[0])
    changed = replace(solution, nuclide=nuclide, log_activity=activities)
    changed = changed.only([k for k in range(len(solution)) if k == first or k not in group])
    for n, one in zip(nuclides[1:], activity[1:], strict=True):
        changed = changed.plus(n, place, float(np.log(one)), height)
    return changed


def _groups(solution: Solution) -> list[tuple[int, ...]]:
    """Return the sources in groups with their neighbours, the strongest source of each group first; each in one group."""
    left = sorted(range(len(solution)), key=lambda k: (-solution.log_activity[k], k))
    groups = []
    while left:
        away = np.hypot(*(solution.place[left] - solution.place[left[0]]).T)
        group = [k for k, apart_m in zip(left, away, strict=True) if apart_m <= _TOGETHER_M]
        left = [k for k in left if k not in group]
        groups.append(tuple(group))
    return groups


def _likely(solution: Solution, prior: Prior) -> Solution:
    """Return the solution with its nuisances limited to likely values, as a wrong spectrum may have spoilt them."""

    def within(value: float, sigma: float) -> float:
        return min(max(value, -_WITHIN * sigma), _WITHIN * sigma)

    return replace(
        solution,
        scale=within(solution.scale, prior.scale),
        scatter=within(solution.scatter, prior.scatter),
        log_background=within(solution.log_background, prior.background),
        soil=np.array([within(value, sigma) for value, sigma in zip(solution.soil.tolist(), prior.soil, strict=False)]),
    )
