"""The information of an exposure's counts on the log rate of the source: at each Gaussian of a track, for each component of
unknown obstacles (``hidden``).
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from radron.agent.fusion.bayes import hidden
from radron.agent.fusion.bayes.counts import MODEL_VARIANCE, TRACK_TEMPER, background_log_likelihood, fit_rate, innovation_squared
from radron.agent.fusion.bayes.motion import ACTIVITY, BIAS, BIASES, GAIN, HEIGHT, SCATTER
from radron.agent.fusion.bayes.sight import LineOfSight, Scene
from radron.agent.fusion.bayes.soil import IMAGE_DEPTH, SoilTable
from radron.agent.fusion.bayes.spectrum import Contrast, soil_share
from radron.agent.fusion.facing import Facing
from radron.agent.geometry import Array, Vector3

_ITERATIONS = 6
_MIN_FLUENCE = 1e-250  # from 60 km on exp(-mu D) is 0, and a share of 0 is undefined
_MAX_GAP_S = 2.0
_ROOM_M = 1.5  # least distance between camera and source for an unknown obstacle
_KNOWN = 0.2  # 1 sigma of the log rate up to which missing counts of an exposure are significant


REJECTED_COST = 1.0  # loss of log Bayes factor by an exposure that the innovation gate rejects
_WHOLE_S = 0.5  # live time of an exposure of full cost; shorter ones cost a share of it


class Exposed(Struct, frozen=True, eq=False):
    """The counts of one vehicle's camera in an exposure (about half a second), prepared for the update of a track (posterior of a
    found source).

    vehicle: index. position: p, mission frame (m). counts: (2,) k, partial-energy and full-energy events. background: (2,)
    expected. middle_ns: UTC, of the exposure's middle. facing: means of cos 2 psi and sin 2 psi over the exposure, psi the
    vehicle's heading (``radron.agent.fusion.facing``).
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
        """Share (0 .. 1) of a whole exposure in live time, so that many short exposures cost no more than one."""
        return min(self.live_time_s / _WHOLE_S, 1.0)

    def follows(self, earlier: Exposed) -> bool:
        """Return whether this exposure follows an earlier one of the vehicle without a long gap."""
        gap_s = (self.middle_ns - earlier.middle_ns) * 1e-9 - (self.live_time_s + earlier.live_time_s) / 2.0
        return gap_s < _MAX_GAP_S


class Fit(Struct, frozen=True, eq=False):
    """The information that an exposure's counts give on the source's rate, at each Gaussian of a track: S sites (places), M
    motion modes.

    The logarithm z of the rate, relative to its expectation, is linearised at each mean m; the Poisson likelihood is not. With
    state s of d variables (place, velocity, log activity a, vehicle's position error b and gain g), covariance P, distance D,
    unit vector u to the source, age T of the exposure, and mu the attenuation coefficient ``air_per_m``:

        S = signal(flux(D) exp(a + g) live_time)                expected counts at m with a clear view
        h = d ln S / ds = -(2 / D + mu) u along x, y and bx, by;  -T times that along vx, vy;  1 along a and g
              over soil also along the height; plus g times the derivative of the contrast (``spectrum``)
        z = h' (s - m) + e ~ N(0, V),  V = h' P h + MODEL_VARIANCE + uncertainty of the component's share of S,

    ``counts.fit_rate`` gives z | k ~ N(z^, v). S has, and h leaves out: the flux of photons scattered by air, which falls off
    less than exp(-mu D) / D^2, and the effects of buildings and of the camera's facing.

    gain: (S, M, d) P h. pull: (S, M) z^ / V and shrink: (S, M) (1 - v / V) / V, of the clear view. log_likelihood: (C, S, M) ln
    P(k | component, m) less ln P(k | no source), for C components (ways in which unknown obstacles attenuate). innovation: (S, M)
    normalised innovation squared of the component with the least one. deficit: (S, M) sigmas by which the counts are below a
    clear view's. contrast: over soil, the information of the two kinds of events on the scatter factor.
    """

    exposed: Exposed
    gain: Array
    pull: Array
    shrink: Array
    log_likelihood: Array
    innovation: Array
    deficit: Array
    contrast: Contrast | None = None

    @staticmethod
    def of(mean: Array, covariance: Array, scene: Scene, exposed: Exposed, age_s: float) -> Fit:
        """Fit the counts of an exposure at each Gaussian of a track.

        mean: (S, M, d) m and covariance: (S, M, d, d) P of S sites, M motion modes and d state variables; age_s: T, of the
        exposure.
        """
        response, background, counts = scene.response, exposed.background, exposed.counts
        sight = LineOfSight.of(mean, scene, exposed.vehicle, exposed.position, age_s)
        spot = sight.spot(covariance)
        distance = np.sqrt(sight.distance * sight.distance + spot)
        log_gain = BIASES + BIAS * exposed.vehicle + GAIN
        fluence = response.flux(distance) * np.exp(mean[..., ACTIVITY] + mean[..., log_gain]) * exposed.live_time_s
        fluence = np.maximum(fluence, _MIN_FLUENCE)
        facing = Facing.of(sight.way[..., 0], sight.way[..., 1], distance, *exposed.facing).cosine()
        shielding = sight.shielding(scene.buildings, exposed.position, mean, covariance) if scene.buildings else None
        by_soil = soil_slope = None
        if (soil := response.over_soil) is not None:
            by_soil, soil_slope = _by_soil(soil, sight, exposed, distance, spot, fluence * np.exp(mean[..., SCATTER]))
        straight, scattered = response.parts(fluence, distance, facing, by_soil)
        expected, unsure = hidden.behind(straight, scattered, shielding)
        slope = (-(2.0 / distance + response.air_per_m) / distance)[..., None] * sight.way
        gradient = sight.gradient(slope, mean.shape[-1])
        if by_soil is not None and soil_slope is not None:
            by_contrast = sight.gradient(soil_slope + (2.0 / (distance * distance))[..., None] * sight.way, mean.shape[-1])
            by_contrast[..., HEIGHT] -= (1.0 + IMAGE_DEPTH) * soil_slope[..., 2]  # the image sinks where the source rises
            by_contrast[..., SCATTER] = 1.0
            gradient += soil_share(by_soil, expected[0], background)[..., None] * by_contrast
        gradient[..., ACTIVITY] = gradient[..., log_gain] = 1.0
        gain = np.matvec(covariance, gradient)
        spread = np.maximum(np.vecdot(gain, gradient), 0.0) + np.square(spot / (distance * distance)) + MODEL_VARIANCE
        variance = spread + unsure
        shift, after, likelihood = fit_rate(counts, expected, background, variance, TRACK_TEMPER, _ITERATIONS)
        contrast = None
        if by_soil is not None:
            fitted = expected * np.exp(shift)[..., None]
            by_soil = by_soil * (hidden.SCATTERED_SHARE[:, None, None] * np.exp(shift))[..., None]
            contrast, ratio = Contrast.of(counts, fitted, background, by_soil, by_contrast, covariance)
            likelihood = likelihood + ratio
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
            contrast=contrast,
        )


def _by_soil(
    soil: SoilTable, sight: LineOfSight, exposed: Exposed, distance: Array, spot: Array, fluence: Array
) -> tuple[Array, Array]:
    """Return expected counts (S, M, 2) of photons scattered by soil, and their ``SoilTable.slope`` (S, M, 3).

    distance: (S, M) D. spot: (S, M) of ``LineOfSight.spot``. fluence: (S, M) with the scatter factor.
    """
    image = sight.image()
    apart = np.sqrt(np.vecdot(image, image) + spot)
    steepness = -image[..., 2] / apart
    facing = Facing.of(image[..., 0], image[..., 1], apart, *exposed.facing).cosine()
    return soil.by_soil(fluence * np.square(distance / apart), steepness, facing), soil.slope(image, apart, steepness)
