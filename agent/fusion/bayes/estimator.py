"""The estimator ``bayes``: search on a grid until the posterior is tight, then track by a Gaussian sum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from agent.config import BayesEstimatorConfig, MissionConfig
from agent.fusion.bayes.cones import orders_of
from agent.fusion.bayes.mixture import ACTIVITY, Mixture
from agent.fusion.bayes.motion import Motion
from agent.fusion.bayes.response import REFERENCE_BQ
from agent.fusion.bayes.search import Grid, SearchState
from agent.fusion.estimator import GridStep, Hypothesis, Outlook
from agent.fusion.observation import ConeObservation, CountObservation, Observation
from protocol.messages import AnyEntry, Cone, Exposure

_NS = 1e9
_SITE_SHARE = 0.45  # sigma of a site that stands for a cell, in cells
_LEAST_SHARE = 1e-4  # of the heaviest cell, for a cell to become a site


@dataclass(frozen=True, slots=True, eq=False)
class BayesState:
    """Either a search or a track, once there is one."""

    search: SearchState | None = None
    track: Mixture | None = None
    cones: int = 0
    x0_stamp_ns: int = 0


class BayesEstimator:
    """The posterior of where a source is, given all cones and counts.

    ``step`` folds all observations of a grid step in the order of their times, whoever made them.
    """

    name = "bayes"
    reads: tuple[type[AnyEntry], ...] = (Cone, Exposure)

    def __init__(self, mission: MissionConfig, bounds: tuple[float, float, float, float]) -> None:
        """``bounds``: west, south, east, north of the area."""
        config = mission.fusion.bayes
        self._config: BayesEstimatorConfig = config
        self._grid = Grid(bounds, config)
        self._vehicles = {drone.id: number for number, drone in enumerate(mission.drones)}
        bias = [config.bias_m**2, config.bias_m**2, np.deg2rad(config.bias_yaw_deg) ** 2]
        self._motion = Motion(
            config.velocity_mps**2,
            config.velocity_s,
            config.switch_ps,
            np.array(bias * len(self._vehicles)),
            config.bias_s,
        )

    def initial(self, start_ns: int | None) -> BayesState:
        """Nothing known."""
        return BayesState()

    def step(self, state: BayesState, step: GridStep, observations: Sequence[Observation]) -> BayesState:
        """Take the step's cones and counts in, in the order of their times."""
        for observation in sorted(observations, key=lambda o: o.stamp_ns):
            state = self._taken_in(state, observation)
        if state.track is not None:
            return replace(state, track=state.track.reduced())
        return self._declared(state, step)

    def hypothesis(self, state: BayesState, step: GridStep) -> Hypothesis | None:
        """Mean and covariance of the track at the beginning of ``step``."""
        if state.track is None:
            return None
        mean, covariance = state.track.later(self._motion, step.start_ns / _NS).moments()
        activity = float(np.exp(mean[ACTIVITY])) * REFERENCE_BQ
        place = np.zeros((3, 3))
        place[:2, :2] = covariance[:2, :2]
        return Hypothesis(
            stamp_ns=step.start_ns,
            position=np.array([mean[0], mean[1], 0.0]),
            covariance=place,
            velocity=np.array([mean[2], mean[3], 0.0]),
            cones=state.cones,
            x0_stamp_ns=state.x0_stamp_ns,
            activity_bq=activity,
            activity_sigma_bq=activity * float(covariance[ACTIVITY, ACTIVITY]) ** 0.5,
        )

    def outlook(self, state: BayesState, step: GridStep) -> Outlook | None:
        """The posterior on the grid of the search, while there is one; at first all is possible."""
        if state.track is not None:
            return None
        search = state.search or SearchState.at_first(self._grid, step.start_ns / _NS)
        return search.later(self._grid, step.start_ns / _NS).outlook(self._grid)

    def _taken_in(self, state: BayesState, observation: Observation) -> BayesState:
        time_s = observation.stamp_ns / _NS
        cones = state.cones + isinstance(observation, ConeObservation)
        if state.track is not None:
            track = state.track.later(self._motion, time_s)
            vehicle = self._vehicles[observation.entry.drone]
            if isinstance(observation, CountObservation):
                track = track.after_counts(vehicle, observation.position, observation.live_time_s, observation.counts)
            else:
                track = track.after_cone(vehicle, observation.apex, orders_of(observation))
            return replace(state, track=track, cones=cones)
        search = state.search or SearchState.at_first(self._grid, time_s)
        search = search.later(self._grid, time_s)
        if isinstance(observation, CountObservation):
            search = search.after_counts(self._grid, observation.position, observation.live_time_s, observation.counts)
        else:
            search = search.after_cone(self._grid, observation.apex, orders_of(observation))
        return replace(state, search=search, cones=cones)

    def _declared(self, state: BayesState, step: GridStep) -> BayesState:
        """Turn to tracking when there is a source, and it is known well enough where."""
        search = state.search
        if search is None or search.none > self._config.doubt:
            return state
        if search.place(self._grid)[2] > self._config.declared_rms_m:
            return state
        return BayesState(None, self._sites(search), state.cones, step.start_ns)

    def _sites(self, search: SearchState) -> Mixture:
        grid = self._grid
        cells = search.weight.sum(axis=1)  # (2, Y, X)
        total = cells.sum(axis=0)
        heavy = total > _LEAST_SHARE * total.max()
        levels = search.weight.sum(axis=0)[:, heavy]  # (A, S)
        share = levels / levels.sum(axis=0)
        mean = np.sum(share * grid.log_activity[:, None], axis=0)
        variance = np.sum(share * (grid.log_activity[:, None] - mean) ** 2, axis=0) + grid.activity_variance
        return Mixture.of_sites(
            search.time_s,
            cells[:, heavy].T,
            grid.x[heavy],
            grid.y[heavy],
            _SITE_SHARE * grid.cell_m,
            mean,
            np.sqrt(variance),
            self._motion,
        ).reduced()
