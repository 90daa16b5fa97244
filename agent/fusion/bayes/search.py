"""The search: weights on a grid of places, activities and whether the source moves; and of there being no source at all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from agent.config import BayesEstimatorConfig
from agent.frames.transform import Vector3
from agent.fusion.bayes.cones import Orders, cone_likelihood
from agent.fusion.bayes.counts import SEARCH_TRUST, fit_rate, log_nothing
from agent.fusion.bayes.response import REFERENCE_BQ, Response
from agent.fusion.estimator import Outlook

Array = NDArray[np.float64]

_MOVE_S = 0.5  # motion is carried out in steps of at least so long
_TINY = 1e-30
_ROUNDS = 3
_DISTANCES = 64  # at which the likelihood of counts is worked out; between them it is interpolated
_EXCLUDED = 0.05  # an activity counts as excluded when the observations have made it so much less likely against no source


class Grid:
    """Places and activities that are held possible. x, y: (Y, X) metres. log_activity: (A,), of REFERENCE_BQ."""

    def __init__(self, bounds: tuple[float, float, float, float], config: BayesEstimatorConfig) -> None:
        """``bounds``: west, south, east, north of the area, mission frame."""
        west, south, east, north = bounds
        self.cell_m = max(config.cell_m, ((east - west) * (north - south) / config.most_cells) ** 0.5)
        columns = np.arange(west + self.cell_m / 2.0, max(east, west + self.cell_m), self.cell_m)
        rows = np.arange(south + self.cell_m / 2.0, max(north, south + self.cell_m), self.cell_m)
        self.x, self.y = np.meshgrid(columns, rows)
        least, most = (np.log(value / REFERENCE_BQ) for value in config.activity_bq)
        self.log_activity = np.linspace(least, most, config.activity_levels)
        self.activity_variance = ((most - least) / (config.activity_levels - 1)) ** 2 / 12.0
        self.diffusion_m2ps = config.search_diffusion_m2ps
        self.prior: Array = np.array(config.motion_prior)


@dataclass(frozen=True, slots=True, eq=False)
class SearchState:
    """weight: (M, A, Y, X) of a source by its mode of motion; ``none``: of no source. They add up to 1."""

    time_s: float
    weight: Array
    none: float

    @staticmethod
    def at_first(grid: Grid, time_s: float) -> SearchState:
        """Nothing known: with or without a source, anywhere, any activity, however it moves."""
        shape = (len(grid.log_activity), *grid.x.shape)
        share = np.full(shape, 0.5 / np.prod(shape))
        return SearchState(time_s, grid.prior[:, None, None, None] * share, 0.5)

    @property
    def evidence(self) -> float:
        """Log of how much likelier the observations are with a source than without."""
        return float(np.log((1.0 - self.none + _TINY) / self.none))

    def later(self, grid: Grid, time_s: float) -> SearchState:
        """The same after the source has had time to move."""
        dt_s = time_s - self.time_s
        if dt_s < _MOVE_S:
            return self
        modes = [self.weight[0]]
        for weight, diffusion_m2ps in zip(self.weight[1:], grid.diffusion_m2ps, strict=True):
            blur = (diffusion_m2ps * dt_s) ** 0.5 / grid.cell_m
            modes.append(gaussian_filter(weight, (0.0, blur, blur), mode="reflect", truncate=3.0))
        return SearchState(time_s, np.stack(modes), self.none)

    def after_counts(self, grid: Grid, response: Response, position: Vector3, live_time_s: float, counts: Array) -> SearchState:
        """After an exposure at a place (mission frame) with counts (3,)."""
        far = _seen_from(grid, position)[0]
        distance = np.geomspace(float(far.min()) * 0.999, float(far.max()) * 1.001, _DISTANCES)
        fluence = response.flux(distance) * np.exp(grid.log_activity)[:, None] * live_time_s
        # What a cell leaves open: its activities, and its places, which differ in distance.
        spread = grid.activity_variance + (2.0 * grid.cell_m / np.maximum(distance, grid.cell_m)) ** 2 / 12.0
        background = response.background_ps * live_time_s
        variance = np.broadcast_to(spread, fluence.shape)
        _, _, likelihood = fit_rate(counts, response.signal(fluence, distance), background, variance, SEARCH_TRUST, _ROUNDS)
        place = np.log(far / distance[0]) * ((_DISTANCES - 1) / np.log(distance[-1] / distance[0]))
        before = place.astype(np.intp)
        part = place - before
        interpolated = likelihood[:, before] * (1.0 - part) + likelihood[:, before + 1] * part
        return self._weighed(interpolated - log_nothing(counts, background, SEARCH_TRUST))

    def after_cone(self, grid: Grid, response: Response, apex: Vector3, orders: Orders) -> SearchState:
        """After a cone."""
        distance, x, y, z = _seen_from(grid, apex)
        u, v, w = orders.axis.T
        cosine = (x[..., None] * u + y[..., None] * v + z * w) / distance[..., None]
        delta = np.arccos(np.clip(cosine, -1.0, 1.0)) - orders.theta_rad
        within = np.broadcast_to((grid.cell_m**2 / 12.0 / distance**2)[..., None], delta.shape)
        directed = orders.density(delta, within)[0].sum(axis=(-2, -1))
        rate = response.cone_area_mm2 * response.flux(distance) * np.exp(grid.log_activity)[:, None, None]
        return self._weighed(np.log(cone_likelihood(rate, directed, response.cone_background_ps)))

    def _weighed(self, log_likelihood: Array) -> SearchState:
        """``log_likelihood``: (A, Y, X), relative to no source."""
        most = max(float(log_likelihood.max()), 0.0)
        weight = self.weight * np.exp(log_likelihood - most) + _TINY
        none = self.none * float(np.exp(-most)) + _TINY
        total = float(weight.sum()) + none
        return SearchState(self.time_s, weight / total, none / total)

    def place(self, grid: Grid) -> tuple[float, float, float]:
        """Mean x and y of the source, if there is one, and the RMS distance from there."""
        cells = self.weight.sum(axis=(0, 1))
        cells = cells / cells.sum()
        x, y = float((cells * grid.x).sum()), float((cells * grid.y).sum())
        return x, y, float((cells * ((grid.x - x) ** 2 + (grid.y - y) ** 2)).sum()) ** 0.5

    def outlook(self, grid: Grid) -> Outlook:
        """What is known of a source that is still searched for."""
        cells = self.weight.sum(axis=0)  # (A, Y, X)
        place = cells.sum(axis=0)
        activity = np.exp((cells * grid.log_activity[:, None, None]).sum(axis=0) / place) * REFERENCE_BQ
        return Outlook(
            places=np.column_stack((grid.x.ravel(), grid.y.ravel())),
            weight=place.ravel(),
            activity_bq=activity.ravel(),
            none=self.none,
            excluded_bq=self._excluded_bq(grid, cells.sum(axis=(1, 2))),
        )

    def _excluded_bq(self, grid: Grid, levels: Array) -> float | None:
        """The least activity from which on every level has become so unlikely against no source as to be excluded."""
        odds = levels * len(levels) / max(self.none, _TINY)  # 1 each at first
        possible = np.flatnonzero(odds > _EXCLUDED)
        first = int(possible[-1]) + 1 if len(possible) else 0
        return float(np.exp(grid.log_activity[first])) * REFERENCE_BQ if first < len(levels) else None


def _seen_from(grid: Grid, position: Vector3) -> tuple[Array, Array, Array, float]:
    """Distance and x, y, z of the places from a camera."""
    x, y, z = grid.x - position[0], grid.y - position[1], -position[2]
    return np.sqrt(x * x + y * y + z * z), x, y, z
