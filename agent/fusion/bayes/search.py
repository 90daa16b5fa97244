"""The search: weights on a grid of places, activities and motions of the source, and of there being no source at all.

For each place and activity, and for there being no source, how strong the background is stays open too: else a background that is
stronger than configured would in the end look like a source.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d, gaussian_filter
from shapely import Polygon, contains_xy

from agent.config import BayesEstimatorConfig
from agent.frames.transform import Vector3
from agent.fusion.bayes.cones import Orders, cone_likelihood
from agent.fusion.bayes.counts import SEARCH_TRUST, fit_rate, log_nothing
from agent.fusion.bayes.mixture import Mixture
from agent.fusion.bayes.motion import ACTIVITY
from agent.fusion.bayes.response import NEAREST_M, REFERENCE_BQ, Response
from agent.fusion.estimator import Outlook
from agent.ground import Ground

Array = NDArray[np.float64]
Weights = NDArray[np.float32]  # there are many of them, and every checkpoint has its own

_MOVE_S = 0.5  # motion is carried out in steps of at least so long
_NARROW = 0.5  # in cells squared; a kernel of three has a variance of 1 at most
_LONGEST_MOVE_S = 60.0  # and counts for so long at most: a stamp may be years off
_OUTLIERS = 0.01  # share of exposures that say nothing: a noisy pixel, a burst; one of them alone makes no source
_TINY = 1e-30
_ROUNDS = 3
_DISTANCES = 64  # at which the likelihood of counts is worked out; between them it is interpolated
_FORGOTTEN = 0.05  # share of a track given up that is put anywhere
_EXCLUDED = 0.05  # an activity counts as excluded when the observations have made it so much less likely against no source


class Grid:
    """What is held possible. x, y, z: (Y, X) metres, of which ``inside`` (Y, X) belong to the area. log_activity: (A,), of
    REFERENCE_BQ. background: (B,) factors of the configured one, and background_prior (B,). motion_prior: (M,) of the modes.
    """

    def __init__(self, area: Polygon, config: BayesEstimatorConfig, ground: Ground) -> None:
        """``area``: mission frame, metres; the places lie on the ground."""
        west, south, east, north = area.bounds
        self.cell_m = max(config.cell_m, ((east - west) * (north - south) / config.most_cells) ** 0.5)
        columns = np.arange(west + self.cell_m / 2.0, max(east, west + self.cell_m), self.cell_m)
        rows = np.arange(south + self.cell_m / 2.0, max(north, south + self.cell_m), self.cell_m)
        self.x, self.y = np.meshgrid(columns, rows)
        self.z: Array = ground.heights_m(np.column_stack((self.x.ravel(), self.y.ravel()))).reshape(self.x.shape)
        self.inside: NDArray[np.bool_] = contains_xy(area.buffer(self.cell_m / 2.0), self.x, self.y)
        least, most = (np.log(value / REFERENCE_BQ) for value in config.activity_bq)
        self.log_activity = np.linspace(least, most, config.activity_levels)
        self.activity_variance = ((most - least) / (config.activity_levels - 1)) ** 2 / 12.0
        self.diffusion_m2ps = config.search_diffusion_m2ps
        self.motion_prior: Array = np.array(config.motion_prior) / sum(config.motion_prior)
        self.background: Array = np.array(config.background_levels)
        prior = np.exp(-0.5 * (np.log(self.background) / config.background_sigma) ** 2)
        self.background_prior: Array = prior / prior.sum()


@dataclass(frozen=True, slots=True, eq=False)
class SearchState:
    """weight: (M, A, Y, X) of a source by its mode of motion; ``none``: of no source. They add up to 1.

    background: (B, A, Y, X) probabilities of the background's levels, if there is a source of that activity at that place;
    background_alone: (B,) if there is none.
    """

    time_s: float
    weight: Weights
    none: float
    background: Weights
    background_alone: Array

    @staticmethod
    def at_first(grid: Grid, time_s: float) -> SearchState:
        """Nothing known: with or without a source, anywhere, any activity, however it moves."""
        shape = (len(grid.log_activity), *grid.x.shape)
        share = np.broadcast_to(grid.inside * np.float32(0.5 / (shape[0] * max(int(grid.inside.sum()), 1))), shape)
        weight = grid.motion_prior[:, None, None, None].astype(np.float32) * share
        background = np.broadcast_to(
            grid.background_prior[:, None, None, None].astype(np.float32), (len(grid.background), *shape)
        )
        return SearchState(time_s, weight, 0.5, background, grid.background_prior)

    @staticmethod
    def of_track(grid: Grid, track: Mixture, none: float) -> SearchState:
        """What a track says that is too wide for Gaussians to stand for it; a little of it is forgotten."""
        first = SearchState.at_first(grid, track.time_s)
        own = track.covariance[..., :2, :2] + grid.cell_m**2 / 12.0 * np.eye(2)
        inverse, density = np.linalg.inv(own), np.zeros(first.weight.shape)
        spread = track.covariance[..., ACTIVITY, ACTIVITY] + grid.activity_variance
        for site, mode in np.ndindex(*track.weight.shape):
            x, y = grid.x - track.mean[site, mode, 0], grid.y - track.mean[site, mode, 1]
            (xx, xy), (_, yy) = inverse[site, mode]
            place = np.exp(-0.5 * (xx * x * x + 2.0 * xy * x * y + yy * y * y)) * np.sqrt(xx * yy - xy * xy)
            away = grid.log_activity - track.mean[site, mode, ACTIVITY]
            level = np.exp(-0.5 * away * away / spread[site, mode])
            density[mode] += track.weight[site, mode] * level[:, None, None] / (level.sum() + _TINY) * place
        density *= grid.inside
        total = density.sum()
        kept = (1.0 - _FORGOTTEN) * density / total if total > 0.0 else 0.0
        weight = kept + _FORGOTTEN * 2.0 * first.weight  # half of a search's weight is that of no source
        weight *= (1.0 - none) / weight.sum()
        return replace(first, weight=weight.astype(np.float32), none=none)

    @property
    def evidence(self) -> float:
        """Log of how much likelier the observations are with a source than without."""
        return float(np.log((1.0 - self.none + _TINY) / self.none))

    def later(self, grid: Grid, time_s: float) -> SearchState:
        """The same after the source has had time to move."""
        dt_s = time_s - self.time_s
        if dt_s < _MOVE_S:
            return self
        dt_s = min(dt_s, _LONGEST_MOVE_S)
        modes = [self.weight[0]]
        for weight, diffusion_m2ps in zip(self.weight[1:], grid.diffusion_m2ps, strict=True):
            modes.append(_blurred(weight, diffusion_m2ps * dt_s / grid.cell_m**2))
        return replace(self, time_s=time_s, weight=np.stack(modes))

    def after_counts(self, grid: Grid, response: Response, position: Vector3, live_time_s: float, counts: Array) -> SearchState:
        """After an exposure at a place (mission frame) with counts (2,)."""
        far = _seen_from(grid, position)[0]
        distance = np.geomspace(float(far.min()) * 0.999, float(far.max()) * 1.001, _DISTANCES)
        fluence = response.flux(distance) * np.exp(grid.log_activity)[:, None] * live_time_s
        # What a cell leaves open: its activities, and its places, which differ in distance.
        spread = grid.activity_variance + (2.0 * grid.cell_m / np.maximum(distance, grid.cell_m)) ** 2 / 12.0
        background = grid.background[:, None] * (response.background_ps * live_time_s)  # (B, 2)
        alone = log_nothing(counts, background, SEARCH_TRUST)  # (B,)
        _, _, table = fit_rate(
            counts,
            response.signal(fluence, distance),
            background[:, None, None, :],
            np.broadcast_to(spread, fluence.shape),
            SEARCH_TRUST,
            _ROUNDS,
        )
        most = max(float(table.max()), float(alone.max()))
        table = np.exp(table - most) + _OUTLIERS
        likelihood = _interpolated(table.astype(np.float32), distance, far)  # (B, A, Y, X)
        by_level = self.background * likelihood
        given_source = by_level.sum(axis=0)
        alone_by_level = self.background_alone * (np.exp(alone - most) + _OUTLIERS)
        given_none = float(alone_by_level.sum())
        weighed = self._weighed(given_source, given_none)
        return replace(
            weighed,
            background=by_level / given_source,
            background_alone=alone_by_level / given_none,
        )

    def after_cone(self, grid: Grid, response: Response, apex: Vector3, orders: Orders) -> SearchState:
        """After a cone."""
        distance, x, y, z = _seen_from(grid, apex)
        u, v, w = orders.axis.T
        cosine = (x[..., None] * u + y[..., None] * v + z[..., None] * w) / distance[..., None]
        delta = np.arccos(np.clip(cosine, -1.0, 1.0)) - orders.theta_rad
        within = np.broadcast_to((grid.cell_m**2 / 12.0 / distance**2)[..., None], delta.shape)
        directed = orders.density(delta, within)[0].sum(axis=(-2, -1))
        rate = response.cone_area_mm2 * response.flux(distance) * np.exp(grid.log_activity)[:, None, None]
        likelihood = cone_likelihood(rate, directed, response.cone_background_ps)
        return self._weighed(likelihood.astype(np.float32), 1.0)

    def _weighed(self, given_source: Weights, given_none: float) -> SearchState:
        """Likelihoods (A, Y, X) of a source there, and of none."""
        weight = self.weight * given_source + np.float32(_TINY)
        none = self.none * given_none + _TINY
        total = float(weight.sum(dtype=np.float64)) + none
        return replace(self, weight=weight / np.float32(total), none=none / total)

    def background_factor(self, grid: Grid) -> float:
        """How strong the background is against the configured one, if there is a source."""
        level = (self.weight.sum(axis=0) * self.background).sum(axis=(1, 2, 3), dtype=np.float64)
        return float(level @ grid.background / level.sum())

    def place(self, grid: Grid) -> tuple[float, float, float]:
        """Mean x and y of the source, if there is one, and the RMS distance from there."""
        cells = self.weight.sum(axis=(0, 1), dtype=np.float64)
        cells = cells / cells.sum()
        x, y = float((cells * grid.x).sum()), float((cells * grid.y).sum())
        return x, y, float((cells * ((grid.x - x) ** 2 + (grid.y - y) ** 2)).sum()) ** 0.5

    def outlook(self, grid: Grid) -> Outlook:
        """What is known of a source that is still searched for."""
        cells = self.weight.sum(axis=0, dtype=np.float64)  # (A, Y, X)
        place = cells.sum(axis=0)
        activity = np.exp((cells * grid.log_activity[:, None, None]).sum(axis=0) / np.maximum(place, _TINY)) * REFERENCE_BQ
        return Outlook(
            places=np.column_stack((grid.x.ravel(), grid.y.ravel())),
            weight=place.ravel(),
            activity_bq=activity.ravel(),
            none=self.none,
            excluded_bq=self._excluded_bq(grid, cells.sum(axis=(1, 2))),
        )

    def _excluded_bq(self, grid: Grid, levels: Array) -> float | None:
        """The least activity from which on every level has become so unlikely against no source, in the mean over the area."""
        odds = levels * len(levels) / max(self.none, _TINY)  # 1 each at first
        possible = np.flatnonzero(odds > _EXCLUDED)
        first = int(possible[-1]) + 1 if len(possible) else 0
        return float(np.exp(grid.log_activity[first])) * REFERENCE_BQ if first < len(levels) else None


def _blurred(weight: Weights, variance: float) -> Weights:
    """Diffused along the last two axes by a variance in cells squared; nothing leaves."""
    if variance > _NARROW:
        blur = variance**0.5
        return np.asarray(gaussian_filter(weight, (0.0, blur, blur), mode="reflect", truncate=3.0))
    to_next = 0.5 * variance  # a Gaussian that is sampled at the cells and cut off would be too narrow, in large cells nothing
    for axis in (-2, -1):
        weight = correlate1d(weight, (to_next, 1.0 - variance, to_next), axis=axis, mode="reflect")
    return weight


def _interpolated(table: Weights, distance: Array, far: Array) -> Weights:
    """A table (..., D) over distances in geometric steps, at the distances ``far`` (Y, X): (..., Y, X)."""
    place = np.log(far / distance[0]) * ((len(distance) - 1) / np.log(distance[-1] / distance[0]))
    before = place.astype(np.intp)
    part = (place - before).astype(np.float32)
    result: Weights = table.take(before, axis=-1)
    rise = np.diff(table, axis=-1).take(before, axis=-1)
    rise *= part
    result += rise
    return result


def _seen_from(grid: Grid, position: Vector3) -> tuple[Array, Array, Array, Array]:
    """Distance and x, y, z of the places from a camera."""
    x, y, z = grid.x - position[0], grid.y - position[1], grid.z - position[2]
    return np.maximum(np.sqrt(x * x + y * y + z * z), NEAREST_M), x, y, z
