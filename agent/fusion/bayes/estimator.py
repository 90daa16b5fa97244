"""The estimator ``bayes``: search on a grid until the posterior is tight, then track by a Gaussian sum."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray
from shapely import Polygon

from agent.config import BayesEstimatorConfig, MissionConfig
from agent.frames.transform import Transform
from agent.fusion.bayes.cones import Orders
from agent.fusion.bayes.mixture import Mixture, rms_m, with_variance
from agent.fusion.bayes.motion import ACTIVITY, BIAS, BIASES, GAIN, Motion
from agent.fusion.bayes.response import REFERENCE_BQ, response_of
from agent.fusion.bayes.search import Grid, SearchState
from agent.fusion.estimator import GridStep, Hypothesis, Outlook, Sight
from agent.fusion.observation import ConeObservation, CountObservation, Observation
from agent.ground import Ground
from protocol.messages import AnyEntry, Cone, Exposure

Array = NDArray[np.float64]

_NS = 1e9
_HOLD_S = 0.25  # until all drones' entries of a moment are mostly there: a camera's readout at 5 Hz, and the radio
_TRACK_UNITS, _SEARCH_UNITS = 8, 60  # of work for an observation
_SITE_SHARE = 0.45  # sigma of a site that stands for a cell, in cells
_LEAST_SHARE = 1e-4  # of the heaviest cell, for a cell to become a site
_MOST_TRUST = 40.0  # log likelihood that is remembered in a track's favour
_TRUST_S = 10.0  # and for how long, of exposures; so a track that is spoken against is given up before long
_LEAST_TRUST = -5.0
_AREA_VARIANCE = 0.08**2  # of the log activity: cameras face the source (I-131: 9 % more), areas are means of all sides
_OUTLIER_COST = 1.0  # log likelihood that an exposure costs which does not fit the track at all


class BayesState(Struct, frozen=True, eq=False):
    """Either a search or a track, once there is one.

    evidence: log likelihood of all observations with the source against none. trust: the same of the last seconds only.
    background: how strong it is against the configured one, as the search found. bias_variance: (BIAS V,) of the vehicles
    that made the search's observations; a track has its own. frames: by vehicle the estimated frame, with its epoch, that
    brought the track's last observation of it here. moments: of the track after the step, for the hypotheses until the next one.
    """

    search: SearchState | None = None
    track: Mixture | None = None
    cones: int = 0
    x0_stamp_ns: int = 0
    evidence: float = 0.0
    trust: float = 0.0
    background: float = 1.0
    bias_variance: Array | None = None
    frames: Mapping[int, tuple[int, Transform]] = {}
    moments: tuple[Array, Array] | None = None


class BayesEstimator:
    """The posterior of where a source is, given all cones and counts.

    ``step`` folds the observations of a grid step in the order of their times, whoever made them.
    """

    name = "bayes"
    reads: tuple[type[AnyEntry], ...] = (Cone, Exposure)
    grid_s: float | None
    hold_s = _HOLD_S

    def __init__(self, mission: MissionConfig, area: Polygon) -> None:
        """``area``: where the source is searched for, mission frame.

        Raises:
            ConfigError: the response to the mission's nuclide is not known.
        """
        config = mission.fusion.bayes
        self._config: BayesEstimatorConfig = config
        self.grid_s = config.grid_s
        self._ground = Ground.from_config(mission)
        self._grid = Grid(area, config, self._ground)
        self._response = response_of(mission.nuclide)
        self._vehicles = {drone.id: number for number, drone in enumerate(mission.drones)}
        self._gain_variance = config.gain_sigma**2
        self._motion = _motion(config)

    def initial(self, start_ns: int | None) -> BayesState:
        """Nothing known."""
        return BayesState()

    def step(self, state: BayesState, step: GridStep, observations: Sequence[Observation]) -> BayesState:
        """Take the step's cones and counts in, in the order of their times."""
        state = self._begun(state, step)
        for observation in sorted(observations, key=lambda o: o.stamp_ns):
            state = self._taken(state, step, observation)
        return self._closed(state, step)

    def work(self, state: BayesState, observations: int) -> int:
        """An observation costs 0.2 ms in the track, and over 1 ms on the grid of the search (benchmarks/fusion.py)."""
        return 4 + observations * (_TRACK_UNITS if state.track is not None else _SEARCH_UNITS)

    def hypothesis(self, state: BayesState, step: GridStep) -> Hypothesis | None:
        """Mean and covariance of the track in the middle of ``step``; now lies anywhere in it."""
        if state.track is None:
            return None
        moments = state.moments or state.track.moments()
        mean, covariance = state.track.moments_at(moments, self._motion, step.middle_ns / _NS)
        if not math.isfinite(float(covariance.sum())):
            return None
        x, y, u, v, log_activity, *_ = mean.tolist()
        activity = math.exp(log_activity) * REFERENCE_BQ
        east, north = rise = self._ground.slope(x, y)
        return Hypothesis(
            stamp_ns=step.middle_ns,
            position=np.array((x, y, self._ground.height_m(x, y))),
            covariance=_on_ground(covariance[:2, :2], rise),
            velocity=np.array((u, v, u * east + v * north)),
            cones=state.cones,
            x0_stamp_ns=state.x0_stamp_ns,
            activity_bq=activity,
            activity_sigma_bq=activity * (float(covariance[ACTIVITY, ACTIVITY]) + _AREA_VARIANCE) ** 0.5,
            evidence=state.evidence,
            sights=_Sights(self._vehicles, mean, covariance, self._ground),
        )

    def outlook(self, state: BayesState, step: GridStep) -> Outlook | None:
        """The posterior on the grid of the search, while there is one; at first all is possible."""
        if state.track is not None:
            return None
        search = state.search or SearchState.at_first(self._grid, step.start_ns / _NS)
        return search.later(self._grid, step.start_ns / _NS).outlook(self._grid)

    def _begun(self, state: BayesState, step: GridStep) -> BayesState:
        """A track is brought to the step's beginning; a search goes from observation to observation."""
        if state.track is None:
            return state
        return replace(state, track=state.track.later(self._motion, step.start_ns / _NS))

    def _taken(self, state: BayesState, step: GridStep, observation: Observation) -> BayesState:
        if state.track is None:
            return self._searched(state, observation)
        return self._tracked(state, state.track, step, observation)

    def _closed(self, state: BayesState, step: GridStep) -> BayesState:
        """The state after a step's last observation."""
        if state.track is None:
            return self._declared(state, step)
        if not state.trust >= _LEAST_TRUST:  # nor if it is no number
            search = SearchState.at_first(self._grid, step.start_ns / _NS)
            return BayesState(search, cones=state.cones, x0_stamp_ns=state.x0_stamp_ns)
        reduced = state.track.reduced()
        moments = reduced.moments()
        if rms_m(moments[1], reduced.bias_variance) > self._config.given_up_rms_m:
            return self._given_up(state, reduced)
        return replace(state, track=reduced, moments=moments)

    def _given_up(self, state: BayesState, track: Mixture) -> BayesState:
        """Search on from what a track says that has become too wide."""
        search = SearchState.of_track(self._grid, track, self._config.doubt)
        return BayesState(search, cones=state.cones, x0_stamp_ns=state.x0_stamp_ns, bias_variance=track.bias_variance)

    def _tracked(self, state: BayesState, track: Mixture, step: GridStep, observation: Observation) -> BayesState:
        vehicle, variance = self._errors_of(observation)
        moved, frames = _moved(state.frames, vehicle, variance, observation)
        track = track.with_vehicle(vehicle, variance, moved)
        cones, trust = state.cones, state.trust
        if isinstance(observation, CountObservation):
            trust *= math.exp(-observation.live_time_s / _TRUST_S)
            age_s = (step.start_ns - observation.middle_ns) / _NS
            background = self._response.background_ps * (state.background * observation.live_time_s)
            taken = track.after_counts(
                self._response,
                self._ground,
                background,
                vehicle,
                observation.position,
                observation.live_time_s,
                self._response.apart(observation.counts),
                age_s,
            )
            track, gained = taken or (track, -_OUTLIER_COST)
        else:
            age_s = (step.start_ns - observation.stamp_ns) / _NS
            track, gained = track.after_cone(
                self._response, self._ground, vehicle, observation.apex, Orders.of(observation), age_s
            )
            cones += 1
        evidence, trust = state.evidence + gained, min(trust + gained, _MOST_TRUST)
        return BayesState(None, track, cones, state.x0_stamp_ns, evidence, trust, state.background, frames=frames)

    def _errors_of(self, observation: Observation) -> tuple[int, tuple[float, ...]]:
        """The vehicle, and the variances (BIAS,) of its biases as its own localisation has them.

        An autopilot's sigma is that of the horizontal distance.
        """
        axis = observation.position_sigma_m**2 / 2.0
        variance = axis, axis, observation.yaw_sigma_rad**2, self._gain_variance
        return self._vehicles[observation.entry.drone], variance

    def _searched(self, state: BayesState, observation: Observation) -> BayesState:
        time_s = observation.stamp_ns / _NS
        cones = state.cones + isinstance(observation, ConeObservation)
        search = state.search or SearchState.at_first(self._grid, time_s)
        search = search.later(self._grid, time_s)
        if isinstance(observation, CountObservation):
            search = search.after_counts(
                self._grid,
                self._response,
                observation.position,
                observation.live_time_s,
                self._response.apart(observation.counts),
            )
        else:
            search = search.after_cone(self._grid, self._response, observation.apex, Orders.of(observation))
        known = np.zeros(BIAS * len(self._vehicles)) if state.bias_variance is None else state.bias_variance
        return replace(state, search=search, cones=cones, bias_variance=with_variance(known, *self._errors_of(observation)))

    def _declared(self, state: BayesState, step: GridStep) -> BayesState:
        """Turn to tracking when there is a source, and it is known well enough where."""
        search = state.search
        if search is None or state.bias_variance is None or not search.none <= self._config.doubt:
            return state
        if not search.place(self._grid)[2] <= self._config.declared_rms_m:
            return state
        trust = min(search.evidence, _MOST_TRUST)
        return BayesState(
            track=self._sites(search, state.bias_variance),
            cones=state.cones,
            x0_stamp_ns=state.x0_stamp_ns or step.start_ns,
            evidence=search.evidence,
            trust=trust,
            background=search.background_factor(self._grid),
        )

    def _sites(self, search: SearchState, bias_variance: Array) -> Mixture:
        grid = self._grid
        cells = search.weight.sum(axis=1)  # (M, Y, X)
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
            bias_variance,
        ).reduced()


class _Sights(Mapping[str, Sight]):
    """Where each vehicle's own localisation puts the source: at its place plus the bias. Worked out when asked for."""

    def __init__(self, vehicles: Mapping[str, int], mean: Array, covariance: Array, ground: Ground) -> None:
        self._vehicles, self._mean, self._covariance, self._ground = vehicles, mean, covariance, ground
        self._known: dict[str, Sight] = {}

    def __len__(self) -> int:
        return len(self._vehicles)

    def __iter__(self) -> Iterator[str]:
        return iter(self._vehicles)

    def __getitem__(self, drone: str) -> Sight:
        known = self._known.get(drone)
        if known is None:
            known = self._known[drone] = self._sight(BIASES + BIAS * self._vehicles[drone])
        return known

    def _sight(self, b: int) -> Sight:
        mean, p = self._mean.tolist(), self._covariance
        x, y = mean[0], mean[1]
        rows = p[:2] + p[b : b + 2]
        place = np.array((x + mean[b], y + mean[b + 1], self._ground.height_m(x, y)))
        return Sight(place, _on_ground(rows[:, :2] + rows[:, b : b + 2], self._ground.slope(x, y)))


def _moved(
    frames: Mapping[int, tuple[int, Transform]], vehicle: int, variance: tuple[float, ...], observation: Observation
) -> tuple[tuple[float, ...] | None, Mapping[int, tuple[int, Transform]]]:
    """By how much (BIAS,) a vehicle's estimated frame was put elsewhere since it was heard last, and the frames with the new one.

    A new epoch has errors of its own.
    """
    epoch, transform = observation.entry.epoch, observation.mission_from_local
    before = frames.get(vehicle)
    if transform.covariance is None or (before is not None and before[1] is transform):
        return None, frames
    now = {**frames, vehicle: (epoch, transform)}
    if before is None:
        return None, now
    if before[0] != epoch:
        return (*(math.sqrt(part) for part in variance[:GAIN]), 0.0), now
    place = observation.apex if isinstance(observation, ConeObservation) else observation.position
    was = before[1].apply_point(transform.inverse().apply_point(place))
    turned = math.remainder(transform.yaw_rad - before[1].yaw_rad, math.tau)
    return (place[0] - was[0], place[1] - was[1], turned, 0.0), now


def _motion(config: BayesEstimatorConfig) -> Motion:
    velocity = (0.0, config.velocity_mps, config.fast_velocity_mps)
    change_ps = np.full((3, 3), config.switch_ps)
    change_ps[1, 2] = change_ps[2, 1] = config.hurry_ps
    drift = (config.bias_drift_m, config.bias_drift_m, np.deg2rad(config.bias_yaw_drift_deg), config.gain_drift)
    np.fill_diagonal(change_ps, 0.0)
    correlation_s = np.array([1e9, config.velocity_s, config.fast_velocity_s])
    return Motion(np.array(velocity) ** 2, correlation_s, change_ps, np.array(drift) ** 2)


def _on_ground(covariance: Array, rise: tuple[float, float]) -> Array:
    """(2, 2) -> (3, 3), of a place on ground that rises by so much per metre east and north."""
    (xx, xy), (yx, yy) = covariance.tolist()
    east, north = rise
    xz, yz = xx * east + xy * north, yx * east + yy * north
    return np.array(((xx, xy, xz), (yx, yy, yz), (xz, yz, east * xz + north * yz)))
