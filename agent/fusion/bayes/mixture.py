"""The track: a Gaussian sum over where the source is, how it moves, how strong it is, and the biases of the vehicles.

Each site of the sum has a Gaussian for each of the M modes of motion (an interacting-multiple-model filter). State of a Gaussian,
dimension d = 5 + 4 V: x, y (mission frame, m), their velocities (m/s), log activity (of REFERENCE_BQ), and for each of the V
vehicles the biases of its position (x, y, m) and heading (rad), measured minus true, and of its camera (logarithm of how much
more it counts than the others).
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from agent.frames.transform import Vector3
from agent.fusion.bayes.cones import ASTRAY, Orders
from agent.fusion.bayes.counts import MODEL_VARIANCE, TRACK_TRUST, fit_rate, log_nothing, surprise
from agent.fusion.bayes.motion import ACTIVITY, BIAS, BIASES, GAIN, HEADING, Motion
from agent.fusion.bayes.response import NEAREST_M, Response
from agent.ground import Ground

Array = NDArray[np.float64]

_ROUNDS = 6
_MIX_S = 1.0  # the modes are mixed this often
_LEAST_WEIGHT = 1e-4  # relative to the heaviest site
_NEAR = 0.5  # sites nearer than this share of their sigma are one
_NEAREST_SINE = 1e-3
_FAR_OFF = 5.0  # by so many sigmas of what was expected, counts do not fit
_SHORTLY_S = 0.6


class _Sight(Struct, frozen=True, eq=False):
    """From a camera to each mean: way (S, M, 3), distance (S, M); rise (S, M, 2) of the ground there, None where it is level."""

    way: Array
    distance: Array
    rise: Array | None


class Mixture(Struct, frozen=True, eq=False):
    """weight: (S, M), mean: (S, M, d), covariance: (S, M, d, d); the second index is the mode of motion.

    bias_variance: (4 V,) of the vehicles' biases at all times; 0 of vehicles that nothing was heard of.
    """

    time_s: float
    mixed_s: float
    weight: Array
    mean: Array
    covariance: Array
    bias_variance: Array

    @staticmethod
    def of_sites(
        time_s: float, weight: Array, x: Array, y: Array, sigma_m: float, log_activity: Array, log_sigma: Array,
        motion: Motion, bias_variance: Array,
    ) -> Mixture:  # fmt: skip
        """From places (S,) of some weight, all with the same sigma, and what is known of the activity there.

        Places and activities are as the vehicles see them, whose biases were not asked for: in truth they are off by the mean of
        the biases.

        weight: (S, M). log_activity, log_sigma: (S,). bias_variance: (BIAS V,), 0 of vehicles that nothing was heard of.
        """
        d = BIASES + len(bias_variance)
        mean = np.zeros((len(x), motion.modes, d))
        mean[..., 0], mean[..., 1], mean[..., ACTIVITY] = x[:, None], y[:, None], log_activity[:, None]
        variance = np.zeros(mean.shape)
        variance[..., :2] = sigma_m**2
        variance[..., 2:4] = motion.velocity_variance[:, None]
        variance[..., ACTIVITY] = (log_sigma**2)[:, None]
        variance[..., BIASES:] = bias_variance
        truth = np.eye(d)  # what the vehicles see -> what is
        share = _shares(bias_variance)
        for place, bias in ((0, 0), (1, 1), (ACTIVITY, GAIN)):
            truth[place, BIASES + bias :: BIAS] = -share
        covariance = truth @ (variance[..., None] * np.eye(d)) @ truth.T
        return Mixture(time_s, time_s, weight / weight.sum(), mean, covariance, bias_variance)

    def later(self, motion: Motion, time_s: float) -> Mixture:
        """The same at a later time; earlier ones are taken as now."""
        dt_ms = round(1e3 * (time_s - self.time_s))
        if dt_ms <= 0:
            return self
        weight, mean, covariance, mixed_s = self.weight, self.mean, self.covariance, self.mixed_s
        if time_s - mixed_s >= _MIX_S:
            weight, mean, covariance = motion.switch(weight, mean, covariance, time_s - mixed_s)
            mixed_s = time_s
        mean, covariance = motion.predict(mean, covariance, self.bias_variance, dt_ms)
        return Mixture(time_s, mixed_s, weight, mean, covariance, self.bias_variance)

    def with_vehicle(self, vehicle: int, variance: tuple[float, ...], moved: tuple[float, ...] | None = None) -> Mixture:
        """Take what is known of a vehicle beforehand: the variances (BIAS,) of its biases at all times.

        moved: (BIAS,) by which the vehicle's frame was put elsewhere since it was heard last. What was wrong with it before is
        wrong no more, or is now: as much as it was moved, its biases are open again.
        """
        priors = with_variance(self.bias_variance, vehicle, variance)
        b = BIAS * vehicle
        heard = bool(self.bias_variance[b : b + BIAS].any())
        if heard and moved is None:
            return self if priors is self.bias_variance else replace(self, bias_variance=priors)
        covariance = self.covariance.copy()
        places = np.arange(BIASES + b, BIASES + b + BIAS)
        if heard and moved is not None:
            covariance[..., places, places] += np.square(moved)
        else:
            covariance[..., places, places] = variance
        return replace(self, covariance=covariance, bias_variance=priors)

    def after_counts(
        self,
        response: Response,
        ground: Ground,
        background: Array,
        vehicle: int,
        position: Vector3,
        live_time_s: float,
        counts: Array,
        age_s: float,
    ) -> tuple[Mixture, float] | None:
        """After an exposure of a vehicle (by its place among the biases) with counts (2,) at a position (mission frame).

        background: (2,) expected. age_s: how long before ``time_s`` the exposure's middle was. Also returns the log likelihood
        against there being no source. The logarithm of the rate is linear in the state near each mean; along that direction the
        counts are fitted. None where they do not fit at all: a noisy pixel, a burst, a dead camera, or a track that is wrong.
        """
        sight = self._seen_from(ground, vehicle, position, age_s)
        distance = sight.distance
        slope = -(2.0 / distance + response.air_per_m) / distance
        gradient = self._gradient(vehicle, slope[..., None] * sight.way, sight.rise, age_s)
        gradient[..., ACTIVITY] = 1.0
        gradient[..., BIASES + BIAS * vehicle + GAIN] = 1.0
        gain = np.matvec(self.covariance, gradient)
        variance = np.maximum(np.vecdot(gain, gradient), 0.0) + MODEL_VARIANCE
        strength = np.exp(self.mean[..., ACTIVITY] + self.mean[..., BIASES + BIAS * vehicle + GAIN])
        expected = response.signal(response.flux(distance) * strength * live_time_s, distance)
        if float((self.weight * surprise(counts, expected, background, variance)).sum()) > _FAR_OFF**2:
            return None
        shift, after, likelihood = fit_rate(counts, expected, background, variance, TRACK_TRUST, _ROUNDS)
        mean = self.mean + gain * (shift / variance)[..., None]
        shrink = (1.0 - after / variance) / variance
        covariance = self.covariance - (shrink[..., None] * gain)[..., :, None] * gain[..., None, :]
        return self._weighed(likelihood - float(log_nothing(counts, background, TRACK_TRUST)), mean, covariance)

    def after_cone(
        self, response: Response, ground: Ground, vehicle: int, apex: Vector3, orders: Orders, age_s: float
    ) -> tuple[Mixture, float]:
        """After a cone: each Gaussian becomes a mixture of what each order says and of the cone saying nothing, and is replaced
        by the Gaussian of the same moments. Returns and age_s as for counts.
        """
        sight = self._seen_from(ground, vehicle, apex, age_s)
        distance = sight.distance
        directions = sight.way / distance[..., None]
        axes = self._turned(vehicle, orders.axis)  # (S, M, K, 3)
        cosine = np.minimum(np.maximum(np.matvec(axes, directions), -1.0), 1.0)
        sine = np.maximum(np.sqrt(1.0 - cosine * cosine), _NEAREST_SINE)
        delta = np.arccos(cosine) - orders.theta_rad
        across = (distance[..., None] * sine)[..., None]
        slope = (cosine[..., None] * directions[..., None, :] - axes) / across  # (S, M, K, 3)
        gradient = self._gradient(vehicle, slope, sight.rise, age_s)  # (S, M, K, d)
        turn = axes[..., 0] * directions[..., None, 1] - axes[..., 1] * directions[..., None, 0]
        gradient[..., BIASES + BIAS * vehicle + HEADING] = turn / sine
        gain = gradient @ self.covariance  # (S, M, K, d)
        density, precision = orders.density(delta, np.maximum(np.vecdot(gain, gradient), 0.0))  # (S, M, K, 2)
        directed = density.sum(axis=(-2, -1))
        rate = response.cone_area_mm2 * response.flux(distance) * np.exp(self.mean[..., ACTIVITY])
        heard = rate * (directed + ASTRAY) + response.cone_background_ps
        share = density * (rate / heard)[..., None, None]
        pull = delta[..., None] * precision
        first = np.vecdot(share, pull)  # (S, M, K)
        second = np.vecdot(share, pull * pull - precision)
        moved = -np.vecmat(first, gain)
        widened = (gain * second[..., None]).swapaxes(-1, -2) @ gain - moved[..., :, None] * moved[..., None, :]
        likelihood = np.log(heard / (rate + response.cone_background_ps))
        return self._weighed(likelihood, self.mean + moved, self.covariance + widened)

    def _seen_from(self, ground: Ground, vehicle: int, position: Vector3, age_s: float) -> _Sight:
        """From the camera to where each mean was age_s ago: on the ground, whose height the vehicle's bias does not change."""
        b, m = BIASES + BIAS * vehicle, self.mean
        place = m[..., :2] - age_s * m[..., 2:4]
        way = np.empty((*m.shape[:2], 3))
        way[..., :2] = place + m[..., b : b + 2]
        rise = None
        if ground.level:
            way[..., 2] = ground.height_m(0.0, 0.0)
        else:
            places = place.reshape(-1, 2)
            way[..., 2] = ground.heights_m(places).reshape(way.shape[:2])
            rise = ground.slopes(places).reshape(place.shape)
        way -= position
        return _Sight(way, np.maximum(np.sqrt(np.vecdot(way, way)), NEAREST_M), rise)

    def _turned(self, vehicle: int, axes: Array) -> Array:
        """Axes (K, 3) as a camera of the right heading would have them, by each Gaussian's bias; (S, M, K, 3)."""
        heading = self.mean[..., BIASES + BIAS * vehicle + HEADING]
        cos, sin = np.cos(heading), np.sin(heading)
        turned = np.empty((*heading.shape, *axes.shape))
        turned[..., 0] = cos[..., None] * axes[:, 0] + sin[..., None] * axes[:, 1]
        turned[..., 1] = cos[..., None] * axes[:, 1] - sin[..., None] * axes[:, 0]
        turned[..., 2] = axes[:, 2]
        return turned

    def _gradient(self, vehicle: int, slope: Array, rise: Array | None, age_s: float) -> Array:
        """Gradients (S, M, ..., d) of measurements whose slopes along the source's position are (S, M, ..., 3).

        The vehicle's bias enters like the position, and the velocity by how old the measurement is. rise: (S, M, 2) of the
        ground, by which a source that is elsewhere lies higher; None where it is level.
        """
        b, flat = BIASES + BIAS * vehicle, slope[..., :2]
        gradient = np.zeros((*slope.shape[:-1], self.mean.shape[-1]))
        gradient[..., b : b + 2] = flat
        if rise is not None:
            flat = flat + slope[..., 2:] * rise.reshape(*rise.shape[:2], *(1,) * (slope.ndim - 3), 2)
        gradient[..., :2], gradient[..., 2:4] = flat, -age_s * flat
        return gradient

    def _weighed(self, log_likelihood: Array, mean: Array, covariance: Array) -> tuple[Mixture, float]:
        most = float(log_likelihood.max())
        weight = self.weight * np.exp(log_likelihood - most)
        total = float(weight.sum())
        after = Mixture(self.time_s, self.mixed_s, weight / total, mean, covariance, self.bias_variance)
        return after, most + float(np.log(total))

    def reduced(self) -> Mixture:
        """Without sites of hardly any weight, and with sites that lie close together made one (of the same moments)."""
        if len(self.weight) == 1:
            return self
        total = self.weight.sum(axis=1)
        kept = np.flatnonzero(total > _LEAST_WEIGHT * total.max())
        order = kept[np.argsort(-total[kept], kind="stable")]
        place = np.sum(self.weight[..., None] * self.mean[..., :2], axis=1) / np.maximum(total, 1e-300)[:, None]
        sigma = np.sqrt(0.5 * np.trace(self.covariance[..., :2, :2], axis1=-2, axis2=-1).max(axis=1))
        groups: list[NDArray[np.intp]] = []
        while len(order):
            first = order[0]
            away = np.hypot(place[order, 0] - place[first, 0], place[order, 1] - place[first, 1])
            joins = (away < _NEAR * sigma[first]) & (sigma[order] < 2.0 * sigma[first])
            joins[0] = True
            groups.append(order[joins])
            order = order[~joins]
        if len(groups) == len(total):
            return self
        weight = np.empty((len(groups), *self.weight.shape[1:]))
        mean, covariance = np.empty((*weight.shape, *self.mean.shape[2:])), np.empty((*weight.shape, *self.covariance.shape[2:]))
        for site, mode in np.ndindex(*weight.shape):
            parts = groups[site], mode
            weight[site, mode] = self.weight[parts].sum()
            mean[site, mode], covariance[site, mode] = _moments(self.weight[parts], self.mean[parts], self.covariance[parts])
        return replace(self, weight=weight / weight.sum(), mean=mean, covariance=covariance)

    def moments(self) -> tuple[Array, Array]:
        """Mean (d,) and covariance (d, d) of all."""
        d = self.mean.shape[-1]
        return _moments(self.weight.ravel(), self.mean.reshape(-1, d), self.covariance.reshape(-1, d, d))

    def moments_at(self, moments: tuple[Array, Array], motion: Motion, time_s: float) -> tuple[Array, Array]:
        """What its ``moments`` are at a time that is not earlier."""
        if time_s - self.time_s > _SHORTLY_S:
            return self.later(motion, time_s).moments()
        mean, covariance = moments[0].copy(), moments[1].copy()
        dt_s = max(0.0, time_s - self.time_s)  # too short for the velocity to change
        mean[:2] += dt_s * mean[2:4]
        covariance[:2] += dt_s * covariance[2:4]
        covariance[:, :2] += dt_s * covariance[:, 2:4]
        return mean, covariance


def rms_m(covariance: Array, bias_variance: Array) -> float:
    """Horizontal RMS of where the vehicles that were heard see the source in the mean, by the covariance (d, d) of a track."""
    return math.sqrt(max(float(covariance.ravel() @ _seeing(bias_variance.tobytes())), 0.0))


def with_variance(bias_variance: Array, vehicle: int, variance: tuple[float, ...]) -> Array:
    """The variances (BIAS V,) with those (BIAS,) of one vehicle; the same array where it has them."""
    own = slice(BIAS * vehicle, BIAS * (vehicle + 1))
    if tuple(bias_variance[own].tolist()) == variance:
        return bias_variance
    changed = bias_variance.copy()
    changed[own] = variance
    return changed


def _shares(bias_variance: Array) -> Array:
    """(V,): the weights of the vehicles in the mean of those that were heard."""
    heard = bias_variance.reshape(-1, BIAS).any(axis=1)
    return np.asarray(heard / max(int(heard.sum()), 1), dtype=np.float64)


@lru_cache(maxsize=256)
def _seeing(biases: bytes) -> Array:
    """(d d,): what the parts of a state's covariance count in that of where the heard vehicles see the source in the mean."""
    bias_variance = np.frombuffer(biases)
    seeing, share = np.zeros((BIASES + len(bias_variance), 2)), _shares(bias_variance)
    for axis in (0, 1):
        seeing[axis, axis] = 1.0
        seeing[BIASES + axis :: BIAS, axis] = share
    return (seeing @ seeing.T).ravel()


def _moments(weight: Array, mean: Array, covariance: Array) -> tuple[Array, Array]:
    """Mean (d,) and covariance (d, d) of a mixture of N Gaussians."""
    count, d = mean.shape
    share = weight / max(float(weight.sum()), 1e-300)
    middle = share @ mean
    apart = mean - middle
    spread = (share @ covariance.reshape(count, d * d)).reshape(d, d)
    return middle, spread + (apart.T * share) @ apart
