"""Exclusion limits of further sources beside the fitted ones, for each nuclide and place.

For a source of activity A at a place, which adds s to the expectation M of a voxel of 2 m and an energy bin, the log likelihood
changes by

    D(A) = sum (k - M) log(1 + s / M) - q Q(A),    Q(A) = sum [s - M log(1 + s / M)],    q = 1 - c' C c / I.

Q is the expected loss where there is no source. The share q of this loss cannot be compensated by a change of background and
fitted sources: I the Fisher information of A, c its cross information with theirs, C their covariance. A is excluded where exp(D)
is at most ``EXCLUDED``, as in ``bayes``; as D is concave in A, so are all greater activities.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.sparse import csr_array

from radron.agent.fusion.bayes.response import REFERENCE_BQ
from radron.agent.fusion.estimator import Exclusion, Outlook
from radron.agent.fusion.sources.counts import CountModel
from radron.agent.fusion.sources.data import Rows
from radron.agent.fusion.sources.fit import Fitted
from radron.agent.fusion.sources.shades import KnownWalls
from radron.agent.fusion.sources.soil import Sight
from radron.agent.fusion.sources.solution import Solution
from radron.agent.fusion.sources.spectra import NEAREST_M, PER_MM2, Spectra
from radron.agent.geometry import Array
from radron.agent.terrain.ground import Ground

EXCLUDED = 0.05  # odds of a source against none, relative to the prior ones
_LOG_EXCLUDED = float(np.log(EXCLUDED))
_REACH_M = 15.0  # reach of the measurements around a place
_NO_NEWS = 20.0  # Q from which on a place is left although it is not excluded: more of the same would not decide it
_GLARE = 0.2  # least share of a source in the spectrum above it, where the fitted sources outshine the background
_KEPT = 0.2  # least q: nearer to a fitted source, a further source cannot be distinguished from it
_LEAST_SHARE = 1e-3  # of a nuclide's strongest bin; weaker ones are left out
_WORST = 12  # places of each nuclide with the greatest excluded activity, where it is computed
_FAINT = 1e-3  # of the least activity: start of that search
_HALVINGS = 14
_TINY = 1e-9

Flags = NDArray[np.bool_]
Indices = NDArray[np.intp]


class Hiding(Struct, frozen=True, eq=False):
    """Sources on the ground that are not excluded.

    log_odds: (G,) D of the least activity, of the nuclide with the weakest exclusion. left: (G,) places of possible sources for
    which further measurements would decide. glare: (G,) places where the fitted sources outshine a further source. limits: (N,)
    activities (in REFERENCE_BQ) that are excluded everywhere else; infinite where none is.
    """

    log_odds: Array
    left: Flags
    glare: Flags
    limits: Array

    def outlook(self, target: Target, nuclides: tuple[str, ...]) -> Outlook:
        """Return the published outlook. The weights are of one source of the least activity, with prior odds of 1."""
        count = len(target.places)
        odds = np.exp(np.minimum(self.log_odds, -_LOG_EXCLUDED)) / count
        none = 1.0 / (1.0 + float(odds.sum()))
        limits = [limit * REFERENCE_BQ if np.isfinite(limit) else None for limit in self.limits.tolist()]
        known = [limit for limit in limits if limit is not None]
        return Outlook(
            places=target.places,
            cell_m=np.full(count, target.cell_m),
            inside=np.ones(count, np.bool_),
            weight=odds * none,
            activity_bq=np.full(count, target.least * REFERENCE_BQ),
            none=none,
            excluded_bq=max(known) if len(known) == len(limits) else None,
            exclusion=Exclusion(dict(zip(nuclides, limits, strict=True)), self.left, self.glare),
        )


@dataclass(frozen=True)
class Target:
    """The searched sources: of ``least`` to ``most`` (in REFERENCE_BQ) at ``places`` (G, 2), ``cell_m`` apart, from ``height_m``
    above.
    """

    places: Array
    cell_m: float
    least: float
    most: float
    height_m: float

    def hiding(
        self, rows: Rows, counts: CountModel, spectra: Spectra, ground: Ground, fitted: Fitted, walls: KnownWalls | None = None
    ) -> Hiding:
        """Return the sources that are not excluded after a fit to these rows, at least one."""
        at = np.column_stack((self.places, ground.heights_m(self.places)))
        seen = _Seen(rows, counts, spectra, at, fitted, walls)
        glare = _glare(at, self, spectra, ground, fitted.solution)[: len(spectra.nuclides)]
        log_odds, left = np.full(len(at), -np.inf), np.zeros(len(at), np.bool_)
        limits = np.empty(len(spectra.nuclides))
        for n in range(len(limits)):
            signal = seen.signal(n)
            glare[n] |= signal.kept < _KEPT
            change, expected = signal.change(np.full(len(at), self.least))
            log_odds = np.maximum(log_odds, np.where(glare[n], -np.inf, change))
            left |= (change > _LOG_EXCLUDED) & (expected < _NO_NEWS) & ~glare[n]
            if glare[n].all():
                limits[n] = np.inf
                continue
            worst = np.argsort(np.where(glare[n], -np.inf, change), kind="stable")[-min(_WORST, int((~glare[n]).sum())) :]
            limits[n] = self._limit(signal.only(worst))
        return Hiding(log_odds, left, np.asarray(glare.any(axis=0)), limits)

    def _limit(self, signal: _Signal) -> float:
        """Return the exclusion limit at all places of a signal; infinite if there is none."""
        low, high = np.full(signal.places, np.log(_FAINT * self.least)), np.full(signal.places, np.log(self.most))
        if (signal.change(np.exp(high))[0] > _LOG_EXCLUDED).any():
            return float("inf")
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            may = signal.change(np.exp(middle))[0] > _LOG_EXCLUDED
            low, high = np.where(may, middle, low), np.where(may, high, middle)
        return float(np.exp(high.max()))


class _Seen:
    """The measurements by voxels, and the P pairs of a place and a voxel within reach of it."""

    def __init__(
        self, rows: Rows, counts: CountModel, spectra: Spectra, at: Array, fitted: Fitted, walls: KnownWalls | None
    ) -> None:
        """``at``: (G, 3) the places."""
        solution = fitted.solution
        level = spectra.level
        self._shapes: Array = spectra.templates(solution.scale, solution.scatter, solution.soil)[:, level]
        self._direct: Array = spectra.direct_templates(solution.scale, solution.soil)[:, level]
        self._spectra, self._level = spectra, level
        self._air_per_m, self._places = spectra.air_per_m, len(at)
        voxels = rows.coarse
        views = counts.views(counts.expected(solution))
        weight = views.information[:, None]
        self._counted: Array = voxels @ (weight * counts.counts)
        self._expected: Array = voxels @ (weight * views.mean)
        live = counts.live_s * views.information * np.exp(solution.bias[counts.drone, 2])
        self._live_s: Array = voxels @ live
        middle = (voxels @ (live[:, None] * counts.place)) / self._live_s[:, None]
        square = (at**2).sum(axis=1)[:, None] + (middle**2).sum(axis=1) - 2.0 * at @ middle.T
        self._place, self._of = np.nonzero(square < _REACH_M**2)
        self._distance: Array = np.sqrt(np.maximum(square[self._place, self._of], NEAREST_M**2))
        self._steepness: Array = np.maximum(middle[self._of, 2] - at[self._place, 2], 0.0) / self._distance
        self._lines = walls.lines(at[self._place], middle[self._of]) if walls else None
        relative = [(voxels @ (weight * part)) / self._expected for part in counts.derivatives(solution)]
        self._relative: Array = np.stack(relative)  # (p, voxels, BINS), of the numbers on which M depends
        self._covariance: Array = fitted.covariance[: len(relative), : len(relative)]

    def signal(self, n: int) -> _Signal:
        """Return the signal of a source of nuclide n."""
        near = self._shapes[n, 0]
        bins = near > _LEAST_SHARE * near.max()
        depth = self._air_per_m[n] * self._distance
        strength = PER_MM2 * np.exp(-depth) / self._distance**2 * self._live_s[self._of]
        each = self._spectra.strengths(Sight(depth, 0.0, self._steepness))
        strengths, shapes = np.stack([strength * each[q] for q in self._level]), self._shapes[n][:, bins]
        if self._lines is not None:
            stopped = 1.0 - self._lines.shares(n).min(axis=0)
            strengths, shapes = (
                np.concatenate((strengths, -stopped * strengths)),
                np.concatenate((shapes, self._direct[n][:, bins])),
            )
        added = np.maximum(strengths.T @ shapes, 0.0)
        counted, expected = (part[:, bins][self._of] for part in (self._counted, self._expected))
        relative = added / expected
        own = np.bincount(self._place, np.einsum("pb,pb->p", added, relative), self._places)
        changed = self._relative[..., bins] @ shapes.T  # (p, voxels, Q)
        cross = sum(self._by_place(one) @ changed[..., q].T for q, one in enumerate(strengths))  # (G, p)
        made_good = ((cross @ self._covariance) * cross).sum(axis=1) / np.maximum(own, _TINY)
        whole = added.sum(axis=1)
        return _Signal(self._place, whole, relative, counted, expected, 1.0 - np.clip(made_good, 0.0, 1.0))

    def _by_place(self, by_pair: Array) -> csr_array:
        """Return a (G, voxels) matrix of (P,)."""
        return csr_array((by_pair, (self._place, self._of)), (self._places, len(self._live_s)))


@dataclass(frozen=True, eq=False)
class _Signal:
    """The signal of one nuclide. place: (P,) of each pair. added: (P,) sum over the bins of s, of a source of REFERENCE_BQ;
    relative: (P, bins) s / M. counted, expected: (P, bins). kept: (G,) q.
    """

    place: Indices
    added: Array
    relative: Array
    counted: Array
    expected: Array
    kept: Array

    @property
    def places(self) -> int:
        """G, the number of places."""
        return len(self.kept)

    def change(self, activity: Array) -> tuple[Array, Array]:
        """Return D and Q, (G,) each, of sources of these activities (G,), in REFERENCE_BQ."""
        each = activity[self.place]
        logarithm = np.log1p(each[:, None] * self.relative)
        counted, expected = (np.einsum("pb,pb->p", part, logarithm) for part in (self.counted, self.expected))
        news, loss = counted - expected, each * self.added - expected
        gained, lost = (np.bincount(self.place, part, self.places).astype(np.float64) for part in (news, loss))
        return gained - self.kept * lost, lost

    def only(self, places: Indices) -> _Signal:
        """Return the signal at some of the places."""
        number = np.full(self.places, -1)
        number[places] = np.arange(len(places))
        kept = number[self.place] >= 0
        relative, counted, expected = (part[kept] for part in (self.relative, self.counted, self.expected))
        return _Signal(number[self.place[kept]], self.added[kept], relative, counted, expected, self.kept[places])


def _glare(at: Array, target: Target, spectra: Spectra, ground: Ground, solution: Solution) -> Flags:
    """Return (N, G) flags of too little contrast to the fitted sources: a source of nuclide n would add less than ``_GLARE``.

    The contrast to the spectrum M measured above the source: the root of sum s^2 / M relative to sum M, mostly of fitted sources.
    """
    shapes = spectra.templates(solution.scale, solution.scatter, solution.soil)
    fitted = np.zeros((len(at), shapes.shape[2]))
    above = at + np.array((0.0, 0.0, target.height_m))
    for k, (n, (x, y)) in enumerate(zip(solution.nuclide, solution.place.tolist(), strict=True)):
        at_source, log_activity = (x, y, ground.height_m(x, y) + solution.height_of(k)), float(solution.log_activity[k])
        distance = np.sqrt(((above - at_source) ** 2).sum(axis=1))[:, None]
        depth = spectra.air_per_m[n] * distance
        steepness = np.maximum(above[:, 2:] - at_source[2], 0.0) / distance
        strengths = spectra.strengths(Sight(depth, 0.0, steepness))
        areas = sum(strengths[q] * shapes[n, q] for q in spectra.level)
        fitted += PER_MM2 * np.exp(log_activity - depth) / distance**2 * np.maximum(areas, 0.0)
    background = spectra.background_ps(solution.scale, solution.soil) * np.exp(solution.log_background)
    expected = fitted + background
    near = spectra.areas(solution.scale, solution.scatter, Sight(steepness=1.0), solution.soil)
    own = target.least * PER_MM2 / target.height_m**2 * near  # (N, BINS)
    squared: Array = own**2 @ (1.0 / expected).T / expected.sum(axis=1)
    glare: Flags = (squared < _GLARE**2) & (fitted.sum(axis=1) > background.sum())
    return glare
