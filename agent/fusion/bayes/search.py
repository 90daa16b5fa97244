"""The search: a point-mass filter [BS71] on a grid of places, activities and motion modes, with "no source" as an alternative.

Hypotheses: H0, no source; or H1 with the cell (x, y), in the area or around it (``grid``), the log activity a and the motion
mode j. For each of them the strength f of the background relative to the configured one is open too, as a level of its own
distribution. Otherwise a background stronger than configured would in the end look like a source. In SearchState

    none = P(H0),   weight[j, a, cell] = P(H1, j, a, cell),
    background[f, a, cell] = P(f | H1, a, cell),   background_alone[f] = P(f | H0).

Poses are assumed exact: the search yields the apparent place of the source (``mixture.Mixture.of_sites`` accounts for biases).
References: radron.agent.fusion.bayes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from radron.agent.fusion.bayes.cones import Orders, cone_likelihood
from radron.agent.fusion.bayes.counts import SEARCH_TEMPER, background_log_likelihood, fit_rate
from radron.agent.fusion.bayes.grid import Grid, Weights
from radron.agent.fusion.bayes.mixture import Mixture
from radron.agent.fusion.bayes.motion import ACTIVITY
from radron.agent.fusion.bayes.response import MIN_SOURCE_DISTANCE_M, REFERENCE_BQ, Response
from radron.agent.fusion.estimator import Outlook
from radron.agent.geometry import Array, Point2, Vector3

_MOVE_S = 0.5  # least time step of the prediction
_MAX_MOVE_S = 60.0  # greatest time step of the prediction: a stamp may be years off
_OUTLIERS = 0.01  # floor of an exposure's relative likelihood: a noisy pixel or a burst alone makes no source
_TINY = 1e-30
_ITERATIONS = 3
_FORGOTTEN = 0.05  # share of the prior in a search that begins from a track
_LIKELIER = 3.0  # odds of a source between area and fence, relative to prior odds: an excluded area alone doubles them
_EXCLUDED = 0.05  # posterior odds, relative to prior odds, below which an activity counts as excluded


@dataclass(frozen=True, slots=True, eq=False)
class SearchState:
    """The posterior of a search for one source: probabilities on a grid of C cells, A activities and M motion modes, and of no
    source.

    weight: (M, A, C) and ``none``: probabilities of the hypotheses of H1 (a source) and of H0 (no source); their sum is 1.
    background: (B, A, C) and background_alone: (B,) probabilities of the B levels of the background's strength given H1's
    hypotheses, and given H0; sums over B are 1.
    """

    time_s: float
    weight: Weights
    none: float
    background: Weights
    background_alone: Array

    @staticmethod
    def prior(grid: Grid, time_s: float) -> SearchState:
        """Return the state before any observation: P(H0) = 1/2, H0 no source; given H1 (a source), the prior over cells and
        modes.

        Over the cells ``grid.prior``, uniform over the levels of the logarithm of the activity, ``motion_prior`` over the modes.
        """
        shape = (len(grid.log_activity), len(grid.x))
        share = np.broadcast_to((0.5 / shape[0] * grid.prior).astype(np.float32), shape)
        weight = grid.motion_prior[:, None, None].astype(np.float32) * share
        background = np.broadcast_to(grid.background_prior[:, None, None].astype(np.float32), (len(grid.background), *shape))
        return SearchState(time_s, weight, 0.5, background, grid.background_prior)

    @staticmethod
    def of_track(grid: Grid, track: Mixture, none: float) -> SearchState:
        """Return the search that continues from a track (posterior of a found source) that has become too wide for a sum of
        Gaussians.

        Its density over place (x, y) and log activity a at the cells is

            (1 - eps) sum_i w_ij N(cell; m_ij, P_ij + cell^2 / 12 I) N(a; ..) + eps prior,   eps = ``_FORGOTTEN``,

        scaled to 1 - none, with weights w_ij, means m_ij and covariances P_ij of the Gaussians of site (candidate place of the
        source) i and motion mode j. Within each Gaussian place and activity are assumed independent, and the vehicles' position
        errors 0. none: probability of no source.
        """
        first = SearchState.prior(grid, track.time_s)
        density = np.zeros(first.weight.shape)
        spread = track.covariance[..., ACTIVITY, ACTIVITY] + grid.activity_variance
        for site, mode in np.ndindex(*track.weight.shape):
            x, y = grid.x - track.mean[site, mode, 0], grid.y - track.mean[site, mode, 1]
            (xx, xy), (_, yy) = track.covariance[site, mode, :2, :2]
            xx, yy = xx + grid.cell_m**2 / 12.0, yy + grid.cell_m**2 / 12.0
            squared = xx * yy - xy * xy
            place = np.exp(-0.5 * (yy * x * x - 2.0 * xy * x * y + xx * y * y) / squared) * grid.cell_m**2 / np.sqrt(squared)
            away = grid.log_activity - track.mean[site, mode, ACTIVITY]
            level = np.exp(-0.5 * away * away / spread[site, mode])
            density[mode] += track.weight[site, mode] * level[:, None] / (level.sum() + _TINY) * place
        density *= grid.prior > 0.0
        total = density.sum()
        kept = (1.0 - _FORGOTTEN) * density / total if total > 0.0 else 0.0
        weight = kept + _FORGOTTEN * 2.0 * first.weight  # half of a search's weight is on no source
        weight *= (1.0 - none) / weight.sum()
        return replace(first, weight=weight.astype(np.float32), none=none)

    @property
    def evidence(self) -> float:
        """Log odds of a source against no source, ln P(H1) / P(H0); with prior odds of 1 the log Bayes factor."""
        return float(np.log((1.0 - self.none + _TINY) / self.none))

    def later(self, grid: Grid, time_s: float) -> SearchState:
        """Predict the posterior to a later time: a moving source diffuses by ``diffusion_m2ps`` t per axis (a random walk).

        Motion modes do not switch. The time t is limited to ``_MAX_MOVE_S``. A step below ``_MOVE_S`` changes nothing, and is
        part of a later one.
        """
        dt_s = time_s - self.time_s
        if dt_s < _MOVE_S:
            return self
        dt_s = min(dt_s, _MAX_MOVE_S)
        moving = zip(self.weight[1:], grid.diffusion_m2ps, strict=True)
        modes = [self.weight[0], *(grid.diffused(weight, rate_m2ps * dt_s) for weight, rate_m2ps in moving)]
        return replace(self, time_s=time_s, weight=np.stack(modes))

    def after_counts(self, grid: Grid, response: Response, position: Vector3, live_time_s: float, counts: Array) -> SearchState:
        """Update the posterior with the counts of an exposure. position: of the camera, mission frame (m); counts: (2,) k, by
        kind of event.

        With a the log activity, f the background's strength, D the distance of a cell, T the live time, B_0 the background rates:

            P(k | f, a, cell) by ``counts.fit_rate`` with S = signal(phi(D) exp(a) T), B = f B_0 T and
              V = activity_variance + (2 cell / max(D, cell))^2 / 12      spread of ln S within a cell
            P(k | f, H0) by ``counts.background_log_likelihood``
            L = P(k | ..) / max P(k | ..) + ``_OUTLIERS``
            P(f | ..) <- P(f | ..) L / l,   weight <- weight l,   l = sum_f P(f | ..) L,   likewise for H0 (no source);
            normalised.

        L depends only on the distance D and the size of a cell: for each size it is tabulated over D and interpolated.
        """
        far, _, _, below = _seen_from(grid, position)
        blocks = grid.by_block(far)
        samples = [block.samples for block in grid.blocks]
        distances = [_around(cells, count) for cells, count in zip(blocks, samples, strict=True)]
        distance, cell_m = np.concatenate(distances), np.repeat([block.cell_m for block in grid.blocks], samples)
        fluence = response.flux(distance) * np.exp(grid.log_activity)[:, None] * live_time_s
        spread = grid.activity_variance + (2.0 * cell_m / np.maximum(distance, cell_m)) ** 2 / 12.0
        background = grid.background[:, None] * (response.background_ps * live_time_s)  # (B, 2)
        alone = background_log_likelihood(counts, background, SEARCH_TEMPER)  # (B,)
        _, _, table = fit_rate(
            counts,
            response.signal(fluence, distance, np.clip(-float(below.mean()) / distance, 0.0, 1.0)),
            np.broadcast_to(background[:, None, None, :], (len(background), *fluence.shape, 2)).copy(),  # in sequence: faster
            np.broadcast_to(spread, fluence.shape),
            SEARCH_TEMPER,
            _ITERATIONS,
        )
        most = max(float(table.max()), float(alone.max()))
        floored: Weights = (np.exp(table - most) + _OUTLIERS).astype(np.float32)
        tables = zip(np.split(floored, np.cumsum(samples)[:-1], axis=-1), distances, blocks, strict=True)
        likelihood = np.concatenate([_interpolated(part, at, cells) for part, at, cells in tables], axis=-1)  # (B, A, C)
        by_level = self.background * likelihood
        given_source = by_level.sum(axis=0)
        alone_by_level = self.background_alone * (np.exp(alone - most) + _OUTLIERS)
        given_none = float(alone_by_level.sum())
        updated = self._reweighted(given_source, given_none)
        return replace(
            updated,
            background=by_level / given_source,
            background_alone=alone_by_level / given_none,
        )

    def after_cone(self, grid: Grid, response: Response, apex: Vector3, orders: Orders) -> SearchState:
        """Update the posterior with a Compton cone. apex: position of the camera, mission frame (m); orders: the cone's readings.

        weight <- weight (R (rho + eps) + B) / (R + B) with ``cones.cone_likelihood``, the angular error taken at the cell's
        centre. The angle spanned by a cell, cell^2 / (12 D^2) at the distance D, is added to the variance of this error. The
        likelihood without a source is 1. The background's level does not enter.
        """
        distance, x, y, z = _seen_from(grid, apex)
        u, v, w = orders.axis.T
        cosine = (x[..., None] * u + y[..., None] * v + z[..., None] * w) / distance[..., None]
        delta = np.arccos(np.clip(cosine, -1.0, 1.0)) - orders.theta_rad
        within = np.broadcast_to((grid.cell_m**2 / 12.0 / distance**2)[..., None], delta.shape)
        directed = orders.density(delta, within)[0].sum(axis=(-2, -1))
        rate = response.cone_area_mm2 * response.flux(distance) * np.exp(grid.log_activity)[:, None]
        likelihood = cone_likelihood(rate, directed, response.cone_background_ps)
        return self._reweighted(likelihood.astype(np.float32), 1.0)

    def _reweighted(self, given_source: Weights, given_none: float) -> SearchState:
        """Apply Bayes' rule. given_source: (A, C) likelihoods under H1, up to a factor common with given_none, that of H0."""
        weight = self.weight * given_source + np.float32(_TINY)
        none = self.none * given_none + _TINY
        total = float(weight.sum(dtype=np.float64)) + none
        return replace(self, weight=weight / np.float32(total), none=none / total)

    def background_factor(self, grid: Grid) -> float:
        """Return the expected strength of the background relative to the tables, given that there is a source."""
        level = (self.weight.sum(axis=0) * self.background).sum(axis=(1, 2), dtype=np.float64)
        return float(level @ grid.background / level.sum())

    def place(self, grid: Grid) -> tuple[float, float, float]:
        """Return the mean place x and y (m) given that there is a source, and the RMS distance from there (m)."""
        cells = self.weight.sum(axis=(0, 1), dtype=np.float64)
        cells = cells / cells.sum()
        x, y = float((cells * grid.x).sum()), float((cells * grid.y).sum())
        return x, y, float((cells * ((grid.x - x) ** 2 + (grid.y - y) ** 2)).sum()) ** 0.5

    def beyond(self, grid: Grid) -> Point2 | None:
        """Return the mean place (m) of a source beyond the fence, if that is more probable than all other possibilities; else
        None.
        """
        cells = self.weight[..., grid.beyond].sum(axis=(0, 1), dtype=np.float64)
        if not cells.sum() > 0.5:
            return None
        x, y = (float(cells @ axis[grid.beyond] / cells.sum()) for axis in (grid.x, grid.y))
        return x, y

    def outlook(self, grid: Grid) -> Outlook:
        """Return the posterior over places, for the guidance of the search and for the report of a search without a source."""
        cells = self.weight.sum(axis=0, dtype=np.float64)  # (A, C)
        place = cells.sum(axis=0)
        activity = np.exp((cells * grid.log_activity[:, None]).sum(axis=0) / np.maximum(place, _TINY)) * REFERENCE_BQ
        return Outlook(
            places=np.column_stack((grid.x, grid.y)),
            cell_m=grid.cell_m,
            inside=grid.inside,
            weight=place,
            activity_bq=activity,
            none=self.none,
            excluded_bq=self._excluded_bq(grid, cells),
            beyond=self.beyond(grid),
        )

    def _excluded_bq(self, grid: Grid, cells: Array) -> float | None:
        """Return the exclusion limit: the least level from which on all levels in the area are excluded.

        Excluded: posterior odds against no source there, relative to the prior's, of at most ``_EXCLUDED``. None without such a
        level, or while a source between area and fence has become likelier, by more than ``_LIKELIER``.

        cells: (A, C) P(a, cell).
        """
        fenced = ~grid.inside & ~grid.beyond
        between, at_first = float(cells[:, fenced].sum()), 0.5 * float(grid.prior[fenced].sum())
        if between * (1.0 - at_first) > _LIKELIER * at_first * (1.0 - between):
            return None
        levels, prior = cells[:, grid.inside].sum(axis=1), 0.5 * float(grid.prior[grid.inside].sum())
        none = max(1.0 - float(levels.sum()), _TINY) / (1.0 - prior)
        possible = np.flatnonzero(levels * len(levels) / prior > _EXCLUDED * none)
        first = int(possible[-1]) + 1 if len(possible) else 0
        return float(np.exp(grid.log_activity[first])) * REFERENCE_BQ if first < len(levels) else None


def _around(far: Array, count: int) -> Array:
    """Return ``count`` distances, evenly spaced in their logarithm, with ``far`` between the first and the last."""
    return np.geomspace(float(far.min()) * 0.999, float(far.max()) * 1.001, count)


def _interpolated(table: Weights, distance: Array, far: Array) -> Weights:
    """Interpolate a table (..., D) linearly over a geometric grid of distances, at the distances far (C,): (..., C)."""
    place = np.log(far / distance[0]) * ((len(distance) - 1) / np.log(distance[-1] / distance[0]))
    before = place.astype(np.intp)
    part = (place - before).astype(np.float32)
    result: Weights = table.take(before, axis=-1, mode="clip")
    rise = np.diff(table, axis=-1).take(before, axis=-1, mode="clip")
    rise *= part
    result += rise
    return result


def _seen_from(grid: Grid, position: Vector3) -> tuple[Array, Array, Array, Array]:
    """Return distance D (at least ``MIN_SOURCE_DISTANCE_M``) and x, y, z of the cells from a camera, (C,) each."""
    x, y, z = grid.x - position[0], grid.y - position[1], grid.z - position[2]
    return np.maximum(np.sqrt(x * x + y * y + z * z), MIN_SOURCE_DISTANCE_M), x, y, z
