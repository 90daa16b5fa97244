"""Updates of a track with an observation: a cone, an exposure, a waiting exposure, or a change of the vehicle's frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from msgspec.structs import replace

from radron.agent.frames.transform import Transform, same
from radron.agent.fusion.bayes.cones import Orders
from radron.agent.fusion.bayes.contradicted import CONE_NATS, is_disputed, rejected
from radron.agent.fusion.bayes.exposed import REJECTED_COST, Exposed, Fit
from radron.agent.fusion.bayes.mixture import Mixture
from radron.agent.fusion.bayes.motion import GAIN
from radron.agent.fusion.bayes.sight import Scene
from radron.agent.fusion.bayes.state import BayesState
from radron.agent.fusion.bayes.turned import with_score
from radron.agent.fusion.estimator import GridStep
from radron.agent.fusion.observation import ConeObservation, CountObservation, Observation
from radron.agent.geometry import Array

EVIDENCE_CAP = 40.0  # of the recent evidence, so that a wrong track is dropped before long
_NS = 1e9
_EVIDENCE_FADE_S = 10.0
_WIDER = 1.2  # variance of the place, after a rejected exposure while only one other vehicle measures


class Tracking:
    """Updates a track (posterior of a found source) with an observation, and with changes of the vehicles' frames."""

    def __init__(
        self,
        scene: Scene,
        vehicles: Mapping[str, int],
        gain_sigma: float,
        beside: Callable[[CountObservation], Array] | None,
    ) -> None:
        """Set up the updates.

        ``vehicles``: index of each drone. ``gain_sigma``: 1 sigma of the logarithm of a camera's sensitivity. ``beside``: as in
        ``BayesEstimator``.
        """
        self._scene, self._vehicles = scene, vehicles
        self._gain_variance, self._beside = gain_sigma**2, beside

    def updated(self, state: BayesState, track: Mixture, step: GridStep, observation: Observation) -> BayesState:
        """Return the estimator's state after an observation of a grid step; ``track``: the track at the step's beginning."""
        vehicle, variance = self.errors_of(observation)
        change, frames = _frame_change(state.frames, vehicle, variance, observation)
        track = track.with_vehicle(vehicle, variance, change)
        is_new_epoch = vehicle in state.frames and state.frames[vehicle][0] != observation.epoch
        waiting = _without(state.waiting, vehicle) if is_new_epoch else state.waiting  # its biases are the former epoch's
        state = replace(state, frames=frames, waiting=waiting)
        contradicted = state.leaves_out(vehicle, observation.stamp_ns)
        if isinstance(observation, CountObservation):
            exposed = self._exposed(state, vehicle, observation)
            if contradicted:
                return self._tested(state, track, step, exposed)
            recent = state.recent_evidence * math.exp(-observation.live_time_s / _EVIDENCE_FADE_S)
            return self._counted(replace(state, recent_evidence=recent), track, step, exposed)
        if contradicted:
            return replace(state, track=track)
        age_s = (step.start_ns - observation.stamp_ns) / _NS
        after, gained, score = track.after_cone(self._scene, vehicle, observation.apex, Orders.of(observation), age_s)
        contrary = rejected(state.contrary, vehicle, observation.stamp_ns, -gained / CONE_NATS)
        turns = with_score(state.turns, vehicle, score)
        return _gained(replace(state, cones=state.cones + 1, contrary=contrary, turns=turns), after, gained)

    def _exposed(self, state: BayesState, vehicle: int, observation: CountObservation) -> Exposed:
        response = self._scene.response
        background = response.background_ps * (state.background * observation.live_time_s)
        if self._beside is not None:
            background = background + self._beside(observation)
        counts = response.apart(observation.counts)
        place, live_s, facing = observation.position, observation.live_time_s, observation.facing
        return Exposed(vehicle, place, live_s, counts, background, observation.middle_ns, facing)

    def _counted(self, state: BayesState, track: Mixture, step: GridStep, exposed: Exposed) -> BayesState:
        """Update with the vehicle's waiting exposure, if any, and with this one, unless it is to wait itself.

        An exposure that waited too long is left out.
        """
        earlier, waiting = state.waiting.get(exposed.vehicle), _without(state.waiting, exposed.vehicle)
        fit = self._fit(track, step, exposed)
        if earlier is not None and exposed.follows(earlier):
            state, track = _fused(state, track, self._fit(track, step, earlier), track.ahead(fit))
            fit = self._fit(track, step, exposed)
        if track.waits(fit):
            return replace(state, track=track, waiting={**waiting, exposed.vehicle: exposed})
        return _fused(replace(state, waiting=waiting), track, fit)[0]

    def _tested(self, state: BayesState, track: Mixture, step: GridStep, exposed: Exposed) -> BayesState:
        """Test an exposure of a contradicted vehicle by the gate, without an update of the track."""
        state = replace(state, track=track, waiting=_without(state.waiting, exposed.vehicle))
        return _noted(state, exposed) if track.rejects(self._fit(track, step, exposed)) else state

    def _fit(self, track: Mixture, step: GridStep, exposed: Exposed) -> Fit:
        return track.fit(self._scene, exposed, (step.start_ns - exposed.middle_ns) / _NS)

    def errors_of(self, observation: Observation) -> tuple[int, tuple[float, ...]]:
        """Return the vehicle's index, and the prior variances (BIAS,) of its position, heading and gain errors.

        They follow from the errors that the vehicle's localisation states. An autopilot's position sigma is horizontal (2D), so
        each axis has sigma^2 / 2.
        """
        axis = observation.position_sigma_m**2 / 2.0
        variance = axis, axis, observation.yaw_sigma_rad**2, self._gain_variance
        return self._vehicles[observation.identity.drone], variance


def _without(waiting: Mapping[int, Exposed], vehicle: int) -> Mapping[int, Exposed]:
    return {other: exposed for other, exposed in waiting.items() if other != vehicle} if vehicle in waiting else waiting


def _fused(state: BayesState, track: Mixture, fit: Fit, ahead: Array | None = None) -> tuple[BayesState, Mixture]:
    """Update with an exposure, unless the gate rejects it; return state and track. ``ahead``: as in ``after_counts``."""
    after = track.after_counts(fit, ahead)
    if after is None:
        exposed, state = fit.exposed, _noted(state, fit.exposed)
        if is_disputed(state.sure, exposed.vehicle, exposed.middle_ns):
            track = track.wider(_WIDER)
        return _gained(state, track, -REJECTED_COST * exposed.weight), track
    return _gained(state, *after), after[0]


def _noted(state: BayesState, exposed: Exposed) -> BayesState:
    """Return the state after the gate has rejected an exposure."""
    return replace(state, rejections=rejected(state.rejections, exposed.vehicle, exposed.middle_ns))


def _gained(state: BayesState, track: Mixture, gained: float) -> BayesState:
    """Return the state with an updated track; gained: log Bayes factor of the update's observation."""
    recent = min(state.recent_evidence + gained, EVIDENCE_CAP)
    return replace(state, track=track, evidence=state.evidence + gained, recent_evidence=recent)


def _frame_change(
    frames: Mapping[int, tuple[int, Transform]], vehicle: int, variance: tuple[float, ...], observation: Observation
) -> tuple[tuple[float, ...] | None, Mapping[int, tuple[int, Transform]]]:
    """Return the change (BIAS,) of a vehicle's estimated frame since its last observation (None: none), and the new frames.

    The change of a place is evaluated at the observation. A new epoch has errors of its own: 1 sigma of each bias.
    """
    epoch, transform = observation.epoch, observation.mission_from_local
    before = frames.get(vehicle)
    if before is not None and same(before[1], transform):
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
