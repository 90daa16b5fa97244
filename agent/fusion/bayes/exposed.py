"""What an exposure's counts say of the logarithm of the source's rate, at each Gaussian of a track and for each component of what
may stand unknown in between (``hidden``).
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from agent.fusion.bayes import hidden
from agent.fusion.bayes.counts import MODEL_VARIANCE, TRACK_TEMPER, background_log_likelihood, fit_rate, innovation_squared
from agent.fusion.bayes.motion import ACTIVITY, BIAS, BIASES, GAIN
from agent.fusion.bayes.sight import LineOfSight, Scene
from agent.fusion.facing import Facing
from agent.geometry import Array, Vector3

_ITERATIONS = 6
_LEAST_FLUENCE = 1e-250  # from 60 km on exp(-mu D) is 0, of which no share can be taken
_LONGEST_GAP_S = 2.0
_ROOM_M = 1.5  # between camera and source, for anything unknown to stand there
_KNOWN = 0.2  # 1 sigma of the logarithm of the rate, up to which an exposure is missed for what it lacks


REJECTED_COST = 1.0  # loss of log Bayes factor by an exposure that the innovation gate rejects
_WHOLE_S = 0.5  # live time of an exposure that costs as much; shorter ones cost a share of it


class Exposed(Struct, frozen=True, eq=False):
    """An exposure of a vehicle (its index). position: p, mission frame. counts: (2,) k. background: (2,) expected.

    middle_ns: UTC, of the exposure's middle. facing: C and S of the heading (``agent.fusion.facing``).
    """

    vehicle: int
    position: Vector3
    live_time_s: float
    counts: Array
    background: Array
    middle_ns: int
    facing: tuple[float, float] = (0.0, 0.0)

    @property
    def weight(self) -> float:
        """Share of a whole exposure, so that many short ones cost no more than one."""
        return min(self.live_time_s / _WHOLE_S, 1.0)

    def follows(self, earlier: Exposed) -> bool:
        """Whether there is no long gap between the earlier exposure and this one."""
        gap_s = (self.middle_ns - earlier.middle_ns) * 1e-9 - (self.live_time_s + earlier.live_time_s) / 2.0
        return gap_s < _LONGEST_GAP_S


class Fit(Struct, frozen=True, eq=False):
    """The logarithm of the rate is linearised at each mean m, the Poisson likelihood is not: with

        S = signal(flux(D) exp(a + g) live_time)                expected counts at m with a clear view
        h = d ln S / ds = -((2 + q) / D + mu) u along x, y and bx, by;  -T times that along vx, vy;  1 along a and g
        z = h' (s - m) + e ~ N(0, V),  V = h' P h + MODEL_VARIANCE + what is not known of the component's share of S,

    ``counts.fit_rate`` gives z | k ~ N(z^, v). (q is ``steep_share``, 0 where nothing is below; mu is ``air_per_m``. That
    scattered photons fall off less than exp(-mu D) / D^2 is left out of h, not of S; so is all that buildings and the camera's
    facing change.)

    gain: (S, M, d) P h. pull: (S, M) z^ / V and shrink: (S, M) (1 - v / V) / V, of the clear view. log_likelihood: (C, S, M)
    ln P(k | component, m) less ln P(k | H0). innovation: (S, M) normalised innovation squared of the component for which it
    is least. deficit: (S, M) by how many sigmas the counts are below those of a clear view.
    """

    exposed: Exposed
    gain: Array
    pull: Array
    shrink: Array
    log_likelihood: Array
    innovation: Array
    deficit: Array

    @staticmethod
    def of(mean: Array, covariance: Array, scene: Scene, exposed: Exposed, age_s: float) -> Fit:
        """mean: (S, M, d) m, covariance: (S, M, d, d) P of the track; age_s: T."""
        response, background, counts = scene.response, exposed.background, exposed.counts
        sight = LineOfSight.of(mean, scene.ground, exposed.vehicle, exposed.position, age_s)
        spot = sight.spot(covariance)
        distance = np.sqrt(sight.distance * sight.distance + spot)
        steepness = np.clip(-sight.way[..., 2] / distance, 0.0, 1.0)
        slope = -((2.0 + response.steep_share(distance, steepness)) / distance + response.air_per_m) / distance
        gradient = sight.gradient(slope[..., None] * sight.way, mean.shape[-1])
        log_gain = BIASES + BIAS * exposed.vehicle + GAIN
        gradient[..., ACTIVITY] = gradient[..., log_gain] = 1.0
        gain = np.matvec(covariance, gradient)
        spread = np.maximum(np.vecdot(gain, gradient), 0.0) + np.square(spot / (distance * distance)) + MODEL_VARIANCE
        fluence = response.flux(distance) * np.exp(mean[..., ACTIVITY] + mean[..., log_gain]) * exposed.live_time_s
        fluence = np.maximum(fluence, _LEAST_FLUENCE)
        facing = Facing.of(sight.way[..., 0], sight.way[..., 1], distance, *exposed.facing).cosine()
        shielding = sight.shielding(scene.buildings, exposed.position, mean, covariance) if scene.buildings else None
        expected, unsure = hidden.behind(*response.parts(fluence, distance, facing, steepness), shielding)
        variance = spread + unsure
        shift, after, likelihood = fit_rate(counts, expected, background, variance, TRACK_TEMPER, _ITERATIONS)
        innovation = innovation_squared(counts, expected, background, variance)
        clear = np.maximum(innovation[0], shift[0] * shift[0] / variance[0])
        known = spread < _KNOWN**2
        fewer = expected[0].sum(axis=-1) + background.sum() > counts.sum()
        return Fit(
            exposed=exposed,
            gain=gain,
            pull=shift[0] / variance[0],
            shrink=(1.0 - after[0] / variance[0]) / variance[0],
            log_likelihood=likelihood - float(background_log_likelihood(counts, background, TRACK_TEMPER)),
            innovation=np.where(distance < _ROOM_M, clear, innovation.min(axis=0)),
            deficit=np.where(known & fewer, np.sqrt(innovation[0]), 0.0),
        )
