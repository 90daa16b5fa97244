"""The estimator ``bayes``: its decisions on the grid search, the declaration of a source, and the end of a track.

Rules (parameters: ``radron.agent.config.BayesEstimatorConfig``):

- Initial estimate x0: a search becomes a track once P(H0) <= ``doubt`` and the RMS of the place given H1 <= ``declared_rms_m``,
  unless the source is probably beyond the fence, where the drones cannot circle it (``SearchState.beyond``).
- Reacquisition: a track becomes a search again, beginning with its density, once the RMS of the apparent place exceeds
  ``given_up_rms_m``.
- Loss: a track is dropped for a search from the prior once its recent evidence falls below ``_EVIDENCE_FLOOR``. Recent evidence
  e is the log Bayes factor H1 : H0 of the last seconds: e <- min(e exp(-T / 10 s) + ln L, 40) with every exposure of live time T,
  and e <- min(e + ln L, 40) with every cone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from msgspec.structs import replace
from shapely import Polygon

from radron.agent.config.estimators import BayesEstimatorConfig
from radron.agent.config.mission import MissionConfig
from radron.agent.fusion.bayes.apparent import Sights, apparent_rms_m, on_ground
from radron.agent.fusion.bayes.cones import Orders
from radron.agent.fusion.bayes.doubted import is_left_out, noted, of_counting
from radron.agent.fusion.bayes.grid import Grid
from radron.agent.fusion.bayes.mixture import Mixture, with_variance
from radron.agent.fusion.bayes.motion import ACTIVITY, BIAS, HEIGHT, Motion
from radron.agent.fusion.bayes.response import REFERENCE_BQ, Response, response_of
from radron.agent.fusion.bayes.search import SearchState
from radron.agent.fusion.bayes.sight import Scene
from radron.agent.fusion.bayes.soil import HEIGHT_SIGMA_M, SCATTER_SIGMA
from radron.agent.fusion.bayes.state import BayesState
from radron.agent.fusion.bayes.tracking import EVIDENCE_CAP, Tracking
from radron.agent.fusion.bayes.turned import turned_deg
from radron.agent.fusion.estimator import GridStep, Hypothesis, Outlook
from radron.agent.fusion.observation import ConeObservation, CountObservation, Observation
from radron.agent.geometry import Array
from radron.agent.terrain.buildings import Buildings
from radron.agent.terrain.ground import Ground
from radron.protocol.entries import AnyEntry, Cone, Exposure

_NS = 1e9
_HOLD_S = 0.25  # usual time for one instant's entries of all drones: a camera's readout at 5 Hz, and the radio
_TRACK_UNITS, _SEARCH_UNITS = 10, 60  # of work for an observation
_SHIELDED_UNITS = 16  # more, in a track, with known buildings
_SITE_SIGMA = 0.45  # of a site that replaces a cell, in cells
_MIN_CELL_SHARE = 1e-4  # of the heaviest cell, for a cell to become a site
_EVIDENCE_FLOOR = -5.0
_RAISED_SIGMA = 0.015  # of the place, each axis, per metre of height: the table of scattered photons is for a source on soil
_AREA_VARIANCE = 0.08**2  # of the log activity: cameras face the source (I-131: 9 % more), areas are means of all sides


class BayesEstimator:
    """The Bayesian estimator of one source: it computes the posterior of place, motion and activity from all cones and counts.

    It is a pure function of the observations and their grid steps. A search is a probability grid over the area; once the source
    is found, a track is a sum of Gaussians. A grid step of a track: prediction to the step's beginning, updates with the step's
    observations, reduction to fewer Gaussians. Each update accounts for the observation's age, so that no observation is moved in
    time. A search is predicted from observation to observation.
    """

    name = "bayes"
    reads: tuple[type[AnyEntry], ...] = (Cone, Exposure)
    grid_s: float | None
    hold_s = _HOLD_S

    def __init__(
        self,
        mission: MissionConfig,
        area: Polygon,
        response: Response | None = None,
        beside: Callable[[CountObservation], Array] | None = None,
    ) -> None:
        """Set up the estimator of a mission.

        ``area``: search area of the source, mission frame. ``response``: of the cameras to the nuclide; None: to the mission's
        nuclide. ``beside``: returns the counts (2,) that a track (posterior of a found source) expects in an exposure besides
        source and background; None: no such counts.

        Raises:
            ConfigError: the response to the mission's nuclide is not known.
        """
        config = mission.fusion.bayes
        self._config: BayesEstimatorConfig = config
        self.grid_s = config.grid_s
        self._ground = Ground.from_config(mission)
        self._grid = Grid(area, mission.area.fence_margin_m, config, self._ground)
        if response is None:
            response = response_of(mission.named(), mission.fusion.ground)
            response = response if config.background_per_s is None else response.with_background(config.background_per_s)
        self._scene = Scene(response, self._ground, Buildings(mission.buildings, response.air_per_m, self._ground))
        self._vehicles = {drone.id: number for number, drone in enumerate(mission.drones)}
        self._tracking = Tracking(self._scene, self._vehicles, config.gain_sigma, beside)
        self._motion = _motion(config, response.over_soil is not None)

    def initial(self, start_ns: int | None) -> BayesState:
        """Return the state before the first observation; it does not depend on the mission's start."""
        return BayesState()

    def step(self, state: BayesState, step: GridStep, observations: Sequence[Observation]) -> BayesState:
        """Return the state after a grid step's cones and counts, in the order of their times; at equal times, of their
        identities.
        """
        state = self._predicted(state, step)
        for observation in sorted(observations, key=lambda o: o.stamp_ns):
            state = self._updated(state, step, observation)
        return self._decided(state, step)

    def work(self, state: BayesState, observations: int) -> int:
        """Return the cost of a step: an observation costs 0.25 ms in a track, over 1 ms on the grid of a search
        (benchmarks/fusion.py).
        """
        tracking = _TRACK_UNITS + (_SHIELDED_UNITS if self._scene.buildings else 0)
        return 4 + observations * (tracking if state.track is not None else _SEARCH_UNITS)

    def hypothesis(self, state: BayesState, step: GridStep) -> Hypothesis | None:
        """Return the source estimate, mean and covariance of the track, predicted to the middle of ``step``; None during a
        search.

        The covariance of the place is wider if the modes of motion differ (``Mixture.hedge``). The apparent places for each
        vehicle (``sights``) and all decisions use the covariance without this hedge.

        Activity: exp(E[a]), the median, with a the log activity; its sigma: exp(E[a]) sqrt(Var[a] + ``_AREA_VARIANCE``), to first
        order. Over soil the place has the source's height, and is wider by ``_RAISED_SIGMA`` times the height. The activity is
        then surface-equivalent: of a source without soil above it.
        """
        if state.track is None:
            return None
        moments = state.moments or state.track.moments()
        mean, covariance = state.track.moments_at(moments, self._motion, step.middle_ns / _NS)
        if not math.isfinite(float(covariance.sum())):
            return None
        x, y, u, v, log_activity, *_ = mean.tolist()
        activity = math.exp(log_activity) * REFERENCE_BQ
        east, north = rise = self._ground.slope(x, y)
        place = on_ground(covariance[:2, :2] + state.track.hedge(*moments), rise)
        height_m = 0.0
        if self._scene.response.over_soil is not None:
            height_m = max(float(mean[HEIGHT]), 0.0)
            place[[0, 1], [0, 1]] += (_RAISED_SIGMA * height_m) ** 2
            place[2, 2] += covariance[HEIGHT, HEIGHT]
        return Hypothesis(
            stamp_ns=step.middle_ns,
            position=np.array((x, y, self._ground.height_m(x, y) + height_m)),
            covariance=place,
            velocity=np.array((u, v, u * east + v * north)),
            cones=state.cones,
            x0_stamp_ns=state.x0_stamp_ns,
            activity_bq=activity,
            activity_sigma_bq=activity * (float(covariance[ACTIVITY, ACTIVITY]) + _AREA_VARIANCE) ** 0.5,
            evidence=state.evidence,
            sights=Sights(self._vehicles, mean, covariance, self._ground, height_m),
            contradicted=tuple(drone for drone, vehicle in self._vehicles.items() if state.leaves_out(vehicle, step.middle_ns)),
            turned_deg={drone: turn for drone, vehicle in self._vehicles.items() if (turn := turned_deg(state.turns, vehicle))},
        )

    def outlook(self, state: BayesState, step: GridStep) -> Outlook | None:
        """Return the posterior of a search over the area, predicted to the beginning of ``step``; None while there is a track."""
        if state.track is not None:
            return None
        search = state.search or SearchState.prior(self._grid, step.start_ns / _NS)
        return search.later(self._grid, step.start_ns / _NS).outlook(self._grid)

    def mixture(self, state: BayesState, stamp_ns: int) -> Mixture | None:
        """Return the track as a sum of Gaussians at a later time, without the hedge of ``hypothesis``; None without a track."""
        return None if state.track is None else state.track.later(self._motion, stamp_ns / _NS)

    def _predicted(self, state: BayesState, step: GridStep) -> BayesState:
        """Predict a track to the step's beginning; leave a search unchanged."""
        if state.track is None:
            return state
        return replace(state, track=state.track.later(self._motion, step.start_ns / _NS))

    def _updated(self, state: BayesState, step: GridStep, observation: Observation) -> BayesState:
        vehicle = self._vehicles[observation.identity.drone]
        if is_left_out(state.sure, vehicle, observation):
            return state
        state = replace(state, sure=noted(state.sure, vehicle, observation))
        if state.track is None:
            return self._update_search(state, observation)
        return self._tracking.updated(state, state.track, step, observation)

    def _decided(self, state: BayesState, step: GridStep) -> BayesState:
        """Decide whether a step ends in a search or a track, by the rules in this module's docstring."""
        if state.track is None:
            return self._declared_or_searching(state, step)
        if not state.recent_evidence >= _EVIDENCE_FLOOR:  # true for NaN too
            search = SearchState.prior(self._grid, step.start_ns / _NS)
            return BayesState(search, cones=state.cones, x0_stamp_ns=state.x0_stamp_ns, sure=state.sure)
        reduced = state.track.reduced()
        moments = reduced.moments()
        counting = of_counting(reduced.bias_variance, state.sure, step.start_ns)
        if apparent_rms_m(moments[1], counting) > self._config.given_up_rms_m:
            return self._reacquiring(state, reduced)
        return replace(state, track=reduced, moments=moments)

    def _reacquiring(self, state: BayesState, track: Mixture) -> BayesState:
        """Return a search that begins with the density of a track that has become too wide."""
        search = SearchState.of_track(self._grid, track, self._config.doubt)
        return BayesState(search, None, state.cones, state.x0_stamp_ns, bias_variance=track.bias_variance, sure=state.sure)

    def _update_search(self, state: BayesState, observation: Observation) -> BayesState:
        time_s = observation.stamp_ns / _NS
        cones = state.cones + isinstance(observation, ConeObservation)
        search = (state.search or SearchState.prior(self._grid, time_s)).later(self._grid, time_s)
        if isinstance(observation, CountObservation):
            search = search.after_counts(
                self._grid,
                self._scene.response,
                observation.position,
                observation.live_time_s,
                self._scene.response.apart(observation.counts),
            )
        else:
            search = search.after_cone(self._grid, self._scene.response, observation.apex, Orders.of(observation))
        known = np.zeros(BIAS * len(self._vehicles)) if state.bias_variance is None else state.bias_variance
        bias_variance = with_variance(known, *self._tracking.errors_of(observation))
        return replace(state, search=search, cones=cones, bias_variance=bias_variance)

    def _declared_or_searching(self, state: BayesState, step: GridStep) -> BayesState:
        """Return a track if the rule of the initial estimate is met, otherwise the unchanged search."""
        search = state.search
        if search is None or state.bias_variance is None or not search.none <= self._config.doubt:
            return state
        if not search.place(self._grid)[2] <= self._config.declared_rms_m or search.beyond(self._grid) is not None:
            return state
        return BayesState(
            track=self._sites(search, of_counting(state.bias_variance, state.sure, step.start_ns)),
            cones=state.cones,
            x0_stamp_ns=state.x0_stamp_ns or step.start_ns,
            evidence=search.evidence,
            recent_evidence=min(search.evidence, EVIDENCE_CAP),
            background=search.background_factor(self._grid),
            sure=state.sure,
        )

    def _sites(self, search: SearchState, bias_variance: Array) -> Mixture:
        """Return the Gaussian sum in place of the grid: a site of sigma 0.45 cells at each cell that is not negligible.

        Its log activity by moment matching over the levels: mean sum_a p_a a, variance sum_a p_a (a - mean)^2 +
        ``activity_variance``.
        """
        grid = self._grid
        cells = search.weight.sum(axis=1)  # (M, C)
        total = cells.sum(axis=0)
        heavy = total > _MIN_CELL_SHARE * total.max()
        levels = search.weight.sum(axis=0)[:, heavy]  # (A, S)
        share = levels / levels.sum(axis=0)
        mean = np.sum(share * grid.log_activity[:, None], axis=0)
        variance = np.sum(share * (grid.log_activity[:, None] - mean) ** 2, axis=0) + grid.activity_variance
        return Mixture.of_sites(
            search.time_s,
            cells[:, heavy].T,
            grid.x[heavy],
            grid.y[heavy],
            _SITE_SIGMA * grid.cell_m[heavy],
            mean,
            np.sqrt(variance),
            self._motion,
            bias_variance,
        ).reduced()


@cache  # one object for all estimators of a process: a key of caches
def _motion(config: BayesEstimatorConfig, over_soil: bool) -> Motion:
    """Return the three modes: at rest, slow (``velocity_mps``, long correlation) and fast.

    The modes switch at the rate ``hurry_ps`` between slow and fast, otherwise at ``switch_ps``.
    """
    velocity = (0.0, config.velocity_mps, config.fast_velocity_mps)
    switching_ps = np.full((3, 3), config.switch_ps)
    switching_ps[1, 2] = switching_ps[2, 1] = config.hurry_ps
    drift = (config.bias_drift_m, config.bias_drift_m, np.deg2rad(config.bias_yaw_drift_deg), config.gain_drift)
    np.fill_diagonal(switching_ps, 0.0)
    correlation_s = np.array([1e9, config.velocity_s, config.fast_velocity_s])
    ground = np.array((SCATTER_SIGMA, HEIGHT_SIGMA_M) if over_soil else ()) ** 2
    return Motion(np.array(velocity) ** 2, correlation_s, switching_ps, np.array(drift) ** 2, ground)
