"""The track: a Gaussian sum [AS72] of IMM filters [BBS88] over the source's state and the biases of the vehicles.

The posterior is p(s, mode j | observations) = sum_i w_ij N(s; m_ij, P_ij), i = 1 .. S sites (hypotheses of the place), j = 1 .. M
motion modes. State s of dimension d = 5 + 4 V: x, y (mission frame, m), vx, vy (m/s), a = ln(activity / REFERENCE_BQ), and for
each of the V vehicles the biases, measured minus true, of its position (bx, by, m) and heading (psi, rad), and of its camera
(g, the logarithm of how much more it counts than the others). The biases are estimated with the source (augmented state).

Measurement model of vehicle i, at time t of a measurement of age T = time_s - t, with p_i its measured camera position:

    w = (x - T vx + bx, y - T vy + by, ground height) - p_i     line of sight from where the camera truly is
    D = |w|,   u = w / D

The ground's height is that below (x - T vx, y - T vy); its slope (``rise``) enters the gradients. References:
agent.fusion.bayes.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from agent.fusion.bayes.cones import OUTLIER_FRACTION, Orders
from agent.fusion.bayes.counts import (
    MODEL_VARIANCE,
    TRACK_TEMPER,
    background_log_likelihood,
    fit_rate,
    innovation_squared,
)
from agent.fusion.bayes.motion import ACTIVITY, BIAS, BIASES, GAIN, HEADING, Motion
from agent.fusion.bayes.reduction import clusters, merged, moments_of
from agent.fusion.bayes.response import NEAREST_M, Response
from agent.fusion.bayes.shielding import Shielding
from agent.geometry import Array, Vector3
from agent.terrain.buildings import Buildings
from agent.terrain.ground import Ground

_ITERATIONS = 6
_MIX_S = 1.0  # the modes are mixed at this interval at least; in the textbook at each step
_LEAST_SINE = 1e-3
_GATE_SIGMAS = 5.0  # an exposure whose normalised innovation is larger is rejected
_SHORT_S = 0.6  # up to this the moments are extrapolated at constant velocity


class _LineOfSight(Struct, frozen=True, eq=False):
    """From a camera to each mean: way (S, M, 3) w, distance (S, M) D; rise (S, M, 2) of the ground there, None if level."""

    way: Array
    distance: Array
    rise: Array | None


class Mixture(Struct, frozen=True, eq=False):
    """weight: (S, M), mean: (S, M, d), covariance: (S, M, d, d); the second index is the motion mode. time_s: of the state;
    mixed_s: when the modes were mixed last.

    bias_variance: (4 V,) stationary variances P0 of the vehicles' biases; 0 of vehicles without measurements so far.
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
        """The Gaussian sum that takes over from the search: a site for each place (S,), all with the same sigma.

        The search ignores the biases, so its places and activities are the apparent ones: y = x + b with b the mean bias of the
        vehicles heard. With y ~ N(place, sigma_m^2) and b_i ~ N(0, P0) independent, the state (x, b) = T (y, b) where
        x = y - sum_i b_i / n over the n vehicles heard (likewise ln activity, with g); its covariance is T diag(..) T'.

        weight: (S, M). log_activity, log_sigma: (S,). bias_variance: (BIAS V,), 0 of vehicles without measurements.
        """
        d = BIASES + len(bias_variance)
        mean = np.zeros((len(x), motion.modes, d))
        mean[..., 0], mean[..., 1], mean[..., ACTIVITY] = x[:, None], y[:, None], log_activity[:, None]
        variance = np.zeros(mean.shape)
        variance[..., :2] = sigma_m**2
        variance[..., 2:4] = motion.velocity_variance[:, None]
        variance[..., ACTIVITY] = (log_sigma**2)[:, None]
        variance[..., BIASES:] = bias_variance
        true_from_apparent = np.eye(d)
        share = _shares(bias_variance)
        for place, bias in ((0, 0), (1, 1), (ACTIVITY, GAIN)):
            true_from_apparent[place, BIASES + bias :: BIAS] = -share
        covariance = true_from_apparent @ (variance[..., None] * np.eye(d)) @ true_from_apparent.T
        return Mixture(time_s, time_s, weight / weight.sum(), mean, covariance, bias_variance)

    def later(self, motion: Motion, time_s: float) -> Mixture:
        """Prediction to a later time (IMM: mixing, then each mode's own prediction); a time before ``time_s`` changes nothing."""
        dt_ms = round(1e3 * (time_s - self.time_s))
        if dt_ms <= 0:
            return self
        weight, mean, covariance, mixed_s = self.weight, self.mean, self.covariance, self.mixed_s
        if time_s - mixed_s >= _MIX_S:
            weight, mean, covariance = motion.mix(weight, mean, covariance, time_s - mixed_s)
            mixed_s = time_s
        mean, covariance = motion.predict(mean, covariance, self.bias_variance, dt_ms)
        return Mixture(time_s, mixed_s, weight, mean, covariance, self.bias_variance)

    def with_vehicle(self, vehicle: int, variance: tuple[float, ...], moved: tuple[float, ...] | None = None) -> Mixture:
        """Set the prior of a vehicle's biases: their stationary variances (BIAS,), as its own localisation states them.

        moved: (BIAS,) by which the estimate of the vehicle's frame has changed since its last measurement. The change may have
        removed a bias that is in the state, or added one: P_bb <- P_bb + moved^2.
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
        self, response: Response, ground: Ground, background: Array, vehicle: int, position: Vector3, live_time_s: float,
        counts: Array, age_s: float, buildings: Buildings | None = None,
    ) -> tuple[Mixture, float] | None:  # fmt: skip
        """Measurement update with an exposure; None if the innovation gate rejects it.

        The logarithm of the rate is linearised at each mean m, the Poisson likelihood is not: with

            S = signal(flux(D) exp(a + g) live_time)                expected counts at m
            h = d ln S / ds = -(2 / D + mu) u along x, y and bx, by;  -T times that along vx, vy;  1 along a and g
            z = h' (s - m) + e ~ N(0, V),  V = h' P h + MODEL_VARIANCE,

        ``counts.fit_rate`` gives z | k ~ N(z^, v), and conditioning of the Gaussian on z

            m <- m + P h z^ / V,   P <- P - P h h' P (1 - v / V) / V,   w <- w P(k | s) / P(k | H0), normalised.

        (mu is ``air_per_m``; that scattered photons fall off less than exp(-mu D) / D^2 is left out of h, not of S.) Gate: the
        mean over all Gaussians of ``counts.innovation_squared`` is at most ``_GATE_SIGMAS``^2. A noisy pixel, a burst and a dead
        camera do not pass, nor do counts far from those of a wrong track.

        vehicle: its index. position: p_i, mission frame. counts: (2,) k. background: (2,) expected. age_s: T, of the exposure's
        middle. buildings: change S, and add to V what is not known of that (``shielding``); left out of h. Also returns
        ln (sum of w P(k | s) / P(k | H0)), the log Bayes factor of the exposure.
        """
        sight = self._line_of_sight(ground, vehicle, position, age_s)
        distance = sight.distance
        slope = -(2.0 / distance + response.air_per_m) / distance
        gradient = self._gradient(vehicle, slope[..., None] * sight.way, sight.rise, age_s)
        gradient[..., ACTIVITY] = 1.0
        gradient[..., BIASES + BIAS * vehicle + GAIN] = 1.0
        gain = np.matvec(self.covariance, gradient)
        variance = np.maximum(np.vecdot(gain, gradient), 0.0) + MODEL_VARIANCE
        strength = np.exp(self.mean[..., ACTIVITY] + self.mean[..., BIASES + BIAS * vehicle + GAIN])
        fluence = response.flux(distance) * strength * live_time_s
        expected = response.signal(fluence, distance)
        if buildings:
            expected, hidden = self._shielding(buildings, vehicle, position, sight).counts(response, fluence, expected)
            variance += hidden
        if float((self.weight * innovation_squared(counts, expected, background, variance)).sum()) > _GATE_SIGMAS**2:
            return None
        shift, after, likelihood = fit_rate(counts, expected, background, variance, TRACK_TEMPER, _ITERATIONS)
        mean = self.mean + gain * (shift / variance)[..., None]
        shrink = (1.0 - after / variance) / variance
        covariance = self.covariance - (shrink[..., None] * gain)[..., :, None] * gain[..., None, :]
        return self._reweighted(likelihood - float(background_log_likelihood(counts, background, TRACK_TEMPER)), mean, covariance)

    def after_cone(
        self, response: Response, ground: Ground, vehicle: int, apex: Vector3, orders: Orders, age_s: float,
        buildings: Buildings | None = None,
    ) -> tuple[Mixture, float]:  # fmt: skip
        """Measurement update with a cone: probabilistic data association [BST75] over its readings and "no information".

        For each reading k, its axis n_k turned by -psi about up, c = n_k . u:

            delta_k = arccos(c) - theta_k
            h_k = d delta_k / ds = (c u - n_k) / (D sin(alpha)) along x, y and bx, by;  -T times that along vx, vy;
                  (n_k x u)_z / sin(alpha) along psi;   alpha = arccos(c).

        With L_kj of ``cones`` at V_kj = h_k' P h_k + (c_j sigma_k)^2, the rates R = ``cone_area_mm2`` phi(D) exp(a) of the
        source's cones (at m, without g) and B of the background's:

            w <- w (R (rho + eps) + B) / (R + B), normalised       marginal likelihood
            gamma_kj = L_kj R / (R (rho + eps) + B)                responsibilities; what is left: no information
            m_kj = m - P h_k delta_k / V_kj,   P_kj = P - P h_k h_k' P / V_kj       an EKF update for each

        and the mixture over kj and "no information" (m, P) is replaced by the Gaussian of its moments:

            m <- m + D,   D = -sum_k P h_k sum_j gamma_kj delta_k / V_kj
            P <- P + sum_k P h_k h_k' P sum_j gamma_kj ((delta_k / V_kj)^2 - 1 / V_kj) - D D'.

        Arguments and the second result as for counts.
        """
        sight = self._line_of_sight(ground, vehicle, apex, age_s)
        distance = sight.distance
        directions = sight.way / distance[..., None]
        axes = self._turned(vehicle, orders.axis)  # (S, M, K, 3)
        cosine = np.minimum(np.maximum(np.matvec(axes, directions), -1.0), 1.0)
        sine = np.maximum(np.sqrt(1.0 - cosine * cosine), _LEAST_SINE)
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
        if buildings:
            rate *= self._shielding(buildings, vehicle, apex, sight).share
        heard = rate * (directed + OUTLIER_FRACTION) + response.cone_background_ps
        share = density * (rate / heard)[..., None, None]  # gamma
        pull = delta[..., None] * precision
        first = np.vecdot(share, pull)  # (S, M, K)
        second = np.vecdot(share, pull * pull - precision)
        moved = -np.vecmat(first, gain)
        widened = (gain * second[..., None]).swapaxes(-1, -2) @ gain - moved[..., :, None] * moved[..., None, :]
        likelihood = np.log(heard / (rate + response.cone_background_ps))
        return self._reweighted(likelihood, self.mean + moved, self.covariance + widened)

    def _line_of_sight(self, ground: Ground, vehicle: int, position: Vector3, age_s: float) -> _LineOfSight:
        """w and D from the camera to where each mean was age_s ago; D is at least ``NEAREST_M``."""
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
        return _LineOfSight(way, np.maximum(np.sqrt(np.vecdot(way, way)), NEAREST_M), rise)

    def _shielding(self, buildings: Buildings, vehicle: int, position: Vector3, sight: _LineOfSight) -> Shielding:
        b = BIASES + BIAS * vehicle
        start = np.broadcast_to(np.array(position), sight.way.shape).copy()
        start[..., :2] -= self.mean[..., b : b + 2]
        return Shielding.of(buildings, start, sight.way, np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)[..., :2]))

    def _turned(self, vehicle: int, axes: Array) -> Array:
        """R_z(-psi) n_k: axes (K, 3) corrected by each Gaussian's heading bias; (S, M, K, 3)."""
        heading = self.mean[..., BIASES + BIAS * vehicle + HEADING]
        cos, sin = np.cos(heading), np.sin(heading)
        turned = np.empty((*heading.shape, *axes.shape))
        turned[..., 0] = cos[..., None] * axes[:, 0] + sin[..., None] * axes[:, 1]
        turned[..., 1] = cos[..., None] * axes[:, 1] - sin[..., None] * axes[:, 0]
        turned[..., 2] = axes[:, 2]
        return turned

    def _gradient(self, vehicle: int, slope: Array, rise: Array | None, age_s: float) -> Array:
        """Gradients h (S, M, ..., d) of measurements whose derivatives along w are slope (S, M, ..., 3).

        h_xy = slope_xy + slope_z rise (a source further up the hill lies higher), h_vxvy = -T h_xy, h_bxby = slope_xy.
        rise: (S, M, 2) of the ground; None if it is level.
        """
        b, flat = BIASES + BIAS * vehicle, slope[..., :2]
        gradient = np.zeros((*slope.shape[:-1], self.mean.shape[-1]))
        gradient[..., b : b + 2] = flat
        if rise is not None:
            flat = flat + slope[..., 2:] * rise.reshape(*rise.shape[:2], *(1,) * (slope.ndim - 3), 2)
        gradient[..., :2], gradient[..., 2:4] = flat, -age_s * flat
        return gradient

    def _reweighted(self, log_likelihood: Array, mean: Array, covariance: Array) -> tuple[Mixture, float]:
        """Bayes' rule for the weights, given log likelihoods (S, M); also the log of the sum of weight times likelihood."""
        most = float(log_likelihood.max())
        weight = self.weight * np.exp(log_likelihood - most)
        total = float(weight.sum())
        after = Mixture(self.time_s, self.mixed_s, weight / total, mean, covariance, self.bias_variance)
        return after, most + float(np.log(total))

    def reduced(self) -> Mixture:
        """Mixture reduction: light sites dropped, near ones merged (``reduction``)."""
        if len(self.weight) == 1:
            return self
        groups = clusters(self.weight, self.mean, self.covariance)
        if len(groups) == len(self.weight):
            return self
        weight, mean, covariance = merged(groups, self.weight, self.mean, self.covariance)
        return replace(self, weight=weight, mean=mean, covariance=covariance)

    def moments(self) -> tuple[Array, Array]:
        """Mean (d,) and covariance (d, d) over all sites and modes."""
        d = self.mean.shape[-1]
        return moments_of(self.weight.ravel(), self.mean.reshape(-1, d), self.covariance.reshape(-1, d, d))

    def moments_at(self, moments: tuple[Array, Array], motion: Motion, time_s: float) -> tuple[Array, Array]:
        """The ``moments`` at a later time: over less than ``_SHORT_S`` at constant velocity and without noise, else predicted."""
        if time_s - self.time_s > _SHORT_S:
            return self.later(motion, time_s).moments()
        mean, covariance = moments[0].copy(), moments[1].copy()
        dt_s = max(0.0, time_s - self.time_s)
        mean[:2] += dt_s * mean[2:4]
        covariance[:2] += dt_s * covariance[2:4]
        covariance[:, :2] += dt_s * covariance[:, 2:4]
        return mean, covariance


def apparent_rms_m(covariance: Array, bias_variance: Array) -> float:
    """Horizontal RMS, metres, of the source's apparent place x + sum_i b_i / n, mean over the n vehicles heard.

    sqrt(tr(A' P A)) with A (d, 2) of ``_apparent``; covariance: (d, d) P.
    """
    return math.sqrt(max(float(covariance.ravel() @ _apparent(bias_variance.tobytes())), 0.0))


def with_variance(bias_variance: Array, vehicle: int, variance: tuple[float, ...]) -> Array:
    """The variances (BIAS V,) with those (BIAS,) of one vehicle; the same array if nothing changes."""
    own = slice(BIAS * vehicle, BIAS * (vehicle + 1))
    if tuple(bias_variance[own].tolist()) == variance:
        return bias_variance
    changed = bias_variance.copy()
    changed[own] = variance
    return changed


def _shares(bias_variance: Array) -> Array:
    """(V,): 1 / n for each of the n vehicles with measurements, else 0."""
    heard = bias_variance.reshape(-1, BIAS).any(axis=1)
    return np.asarray(heard / max(int(heard.sum()), 1), dtype=np.float64)


@lru_cache(maxsize=256)
def _apparent(biases: bytes) -> Array:
    """(d d,): A A' with A (d, 2) such that A' s is the apparent place; tr(A' P A) is its product with P, summed."""
    bias_variance = np.frombuffer(biases)
    apparent, share = np.zeros((BIASES + len(bias_variance), 2)), _shares(bias_variance)
    for axis in (0, 1):
        apparent[axis, axis] = 1.0
        apparent[BIASES + axis :: BIAS, axis] = share
    return (apparent @ apparent.T).ravel()
