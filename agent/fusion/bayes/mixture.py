"""The track: a Gaussian sum [AS72] of IMM filters [BBS88] over the source's state and the biases of the vehicles.

The posterior is p(s, mode j | observations) = sum_i w_ij N(s; m_ij, P_ij), i = 1 .. S sites (hypotheses of the place), j = 1 .. M
motion modes. State s of dimension d = 5 + 4 V: x, y (mission frame, m), vx, vy (m/s), a = ln(activity / REFERENCE_BQ), and for
each of the V vehicles the biases, measured minus true, of its position (bx, by, m) and heading (psi, rad), and of its camera
(g, the logarithm of its sensitivity relative to the others). The biases are estimated with the source (augmented state).

Each vehicle has a hidden Markov chain of the obstacles between its camera and the source (``hidden``), for each site. Measurement
model of vehicle i, at time t of a measurement of age T = time_s - t, with p_i its measured camera position (``sight``):

    w = (x - T vx + bx, y - T vy + by, ground height) - p_i     line of sight from the camera's true position
    D = |w|,   u = w / D

References: radron.agent.fusion.bayes.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from radron.agent.fusion.bayes import hidden
from radron.agent.fusion.bayes.apparent import shares
from radron.agent.fusion.bayes.cones import OUTLIER_FRACTION, Orders
from radron.agent.fusion.bayes.exposed import REJECTED_COST, Exposed, Fit
from radron.agent.fusion.bayes.motion import ACTIVITY, BIAS, BIASES, GAIN, HEADING, SCATTER, Motion
from radron.agent.fusion.bayes.reduction import clusters, merged, moments_of
from radron.agent.fusion.bayes.sight import LineOfSight, Scene
from radron.agent.geometry import Array, Vector3

_MIX_S = 1.0  # greatest interval of mixing the modes; in the textbook at each step
_MIN_DIRECTION_SINE = 1e-3
_LOW_SIGMAS = 1.0  # an exposure lower by more waits for the next one
_MIN_CLEAR = 0.3  # least probability of a clear view before, for an exposure to wait
_GATE_SIGMAS = 5.0  # an exposure with a larger normalised innovation is rejected
_HEDGE_SIGMAS, _POSSIBLE = 3.0, (0.002, 0.005)  # no mode of this weight lies farther from the published Gaussian
_MIN_DETERMINANT = 1e-12  # m4, of a covariance: against rounding
_SOIL_SHARE = 0.5  # of soil in the weighted counts of a search, which assumes a scatter factor of 1
_SHORT_S = 0.6  # up to this interval the moments are extrapolated at constant velocity


class Mixture(Struct, frozen=True, eq=False):
    """A track of the source: its posterior as a sum of Gaussians over S sites (candidate places) and M motion modes, d state
    variables.

    weight: (S, M), mean: (S, M, d), covariance: (S, M, d, d). time_s: of the state; mixed_s: time of the last mixing of the
    modes. bias_variance: (4 V,) stationary variances P0 of the errors (biases) of V vehicles: position, heading, gain; 0 of
    vehicles without measurements so far. hidden: (S, V, L) probabilities of the L levels of attenuation between source and each
    vehicle's camera.
    """

    time_s: float
    mixed_s: float
    weight: Array
    mean: Array
    covariance: Array
    bias_variance: Array
    hidden: Array

    @staticmethod
    def of_sites(
        time_s: float, weight: Array, x: Array, y: Array, sigma_m: Array, log_activity: Array, log_sigma: Array,
        motion: Motion, bias_variance: Array,
    ) -> Mixture:  # fmt: skip
        """Return the sum of Gaussians that takes over from the grid of a search: one site for each of S candidate places.

        The search ignores the vehicles' errors (biases b), so its places and activities are the apparent ones: y = x + b with b
        the mean bias of the n vehicles with measurements. With y ~ N(place, sigma_m^2) and b_i ~ N(0, P0) independent, the state
        (x, b) = T (y, b) where x = y - sum_i b_i / n (likewise ln activity, with the gains g); its covariance is T diag(..) T'.

        weight: (S, M). x, y: (S,) places. sigma_m, log_activity, log_sigma: (S,). bias_variance: (BIAS V,), 0 of vehicles without
        measurements.
        """
        biases_end = BIASES + len(bias_variance)
        d = biases_end + len(motion.ground_variance)
        mean = np.zeros((len(x), motion.modes, d))
        mean[..., 0], mean[..., 1], mean[..., ACTIVITY] = x[:, None], y[:, None], log_activity[:, None]
        variance = np.zeros(mean.shape)
        variance[..., :2] = (sigma_m**2)[:, None, None]
        variance[..., 2:4] = motion.velocity_variance[:, None]
        variance[..., ACTIVITY] = (log_sigma**2)[:, None]
        variance[..., BIASES:biases_end] = bias_variance
        variance[..., biases_end:] = motion.ground_variance
        true_from_apparent = np.eye(d)
        share = shares(bias_variance)
        for place, bias in ((0, 0), (1, 1), (ACTIVITY, GAIN)):
            true_from_apparent[place, BIASES + bias : biases_end : BIAS] = -share
        if d > biases_end:
            true_from_apparent[ACTIVITY, SCATTER] = -_SOIL_SHARE
        covariance = true_from_apparent @ (variance[..., None] * np.eye(d)) @ true_from_apparent.T
        levels = np.tile(hidden.PRIOR, (len(x), len(bias_variance) // BIAS, 1))
        return Mixture(time_s, time_s, weight / weight.sum(), mean, covariance, bias_variance, levels)

    def later(self, motion: Motion, time_s: float) -> Mixture:
        """Predict the track (posterior of a found source) to a later time; an earlier time changes nothing.

        Interacting multiple models (IMM): mixing of the motion modes, then each mode's own prediction.
        """
        dt_ms = round(1e3 * (time_s - self.time_s))
        if dt_ms <= 0:
            return self
        weight, mean, covariance, mixed_s = self.weight, self.mean, self.covariance, self.mixed_s
        if time_s - mixed_s >= _MIX_S:
            weight, mean, covariance = motion.mix(weight, mean, covariance, time_s - mixed_s)
            mixed_s = time_s
        mean, covariance = motion.predict(mean, covariance, self.bias_variance, dt_ms)
        return Mixture(time_s, mixed_s, weight, mean, covariance, self.bias_variance, self.hidden)

    def with_vehicle(self, vehicle: int, variance: tuple[float, ...], moved: tuple[float, ...] | None = None) -> Mixture:
        """Set the prior of one vehicle's errors (biases): stationary variances (BIAS,) of position, heading and gain.

        moved: (BIAS,) change of the vehicle's estimated frame since its last measurement. The change may have removed a bias b
        that is in the state, or added one: P_bb <- P_bb + moved^2.
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

    def fit(self, scene: Scene, exposed: Exposed, age_s: float) -> Fit:
        """Fit the counts of an exposure to those expected at each Gaussian of the track; age_s: age of the exposure's middle."""
        return Fit.of(self.mean, self.covariance, scene, exposed, age_s)

    def waits(self, fit: Fit) -> bool:
        """Return whether an exposure must wait for the vehicle's next one, because the view may have become hidden during the
        exposure.

        Condition: fewer counts than in a clear view, and a clear view before. An exposure partly behind a wall's edge looks like
        a source farther away; the next exposure distinguishes the two.
        """
        clear = float(self.weight.sum(axis=1) @ self.hidden[:, fit.exposed.vehicle, 0])
        return clear > _MIN_CLEAR and float((self.weight * fit.deficit).sum()) > _LOW_SIGMAS

    def rejects(self, fit: Fit) -> bool:
        """Return whether an exposure is rejected, because its counts are too far from the expected ones.

        The test (innovation gate) is a normalised innovation squared above ``_GATE_SIGMAS``^2. It is the mean over all Gaussians,
        each with the obstacle component of the least innovation. A noisy pixel and a burst do not pass; a dead camera passes
        without information, as behind a thick wall.
        """
        return not float((self.weight * fit.innovation).sum()) <= _GATE_SIGMAS**2  # true for NaN too

    def ahead(self, fit: Fit) -> Array:
        """Return the likelihood (S, L) of an exposure given the level of attenuation before it, up to a factor for each site.

        S sites (candidate places) and L levels of attenuation by unknown obstacles.
        """
        most = fit.log_likelihood.max(axis=(0, 2))
        given = np.einsum("sm,csm->sc", self.weight, np.exp(fit.log_likelihood - most[:, None]))
        return hidden.given_level(given, fit.exposed.live_time_s)

    def after_counts(self, fit: Fit, ahead: Array | None = None) -> tuple[Mixture, float] | None:
        """Update the track with the counts of an exposure; return None if they are too far from the expected ones (``rejects``).

        For each component c (way in which an unknown obstacle attenuates, ``hidden``), of probability p_c, g_c ~ p_c P(k | c, s)
        b_c, sum 1, with k the counts and s the source's state. The Gaussian is conditioned on the fitted logarithm of the rate
        for the clear view, c = 0, and not for any other. Moments are matched over both. The transmission of an obstacle is
        unknown for as long as the source is hidden. So counts behind it carry no information on place and activity. With levels
        assumed independent from one exposure to the next, their spread would average out and bias the place with great certainty.

            u = g_0 z^_0 / V_0
            m <- m + P h u
            P <- P - P h h' P (g_0 ((1 - v_0 / V_0) / V_0 - (z^_0 / V_0)^2) + u^2)
            w <- w sum_c p_c P(k | c, s) / P(k | H0), normalised,

        with weight w, mean m and covariance P of each Gaussian, h, z^, v and V as in ``Fit``, H0 no source. Over soil the same
        follows for the contrast (division of the counts into partial-energy and full-energy events, ``spectrum``), by one step of
        Fisher scoring, with P h_d in place of P h, u / (1 + h_d' P h_d I) of z^ / V, and I / (1 + h_d' P h_d I) of (1 - v / V) /
        V.

        ahead: of the vehicle's next exposure, b_c at the level at the end of c: one step of fixed-lag smoothing. It changes
        neither w nor the chain, which that exposure updates later. Also returns ln (sum of w P(k | s) / P(k | H0)), the log Bayes
        factor of the exposure, less the cost of a hidden view, equal to that of a rejected exposure.
        """
        if self.rejects(fit):
            return None
        vehicle = fit.exposed.vehicle
        prior = hidden.components(self.hidden[:, vehicle], fit.exposed.live_time_s)
        joint = fit.log_likelihood + np.log(prior.T)[..., None]  # (C, S, M)
        most = joint.max(axis=0)
        share = np.exp(joint - most)
        total = share.sum(axis=0)
        smoothed = share if ahead is None else share * hidden.at_end(ahead).T[..., None]
        smoothed = smoothed / smoothed.sum(axis=0)
        clear_view = smoothed[0]
        mean, covariance = _conditioned(self.mean, self.covariance, fit.gain, fit.pull, fit.shrink, clear_view)
        if (contrast := fit.contrast) is not None:
            gain = np.matvec(covariance, contrast.gradient)
            known = 1.0 + np.vecdot(gain, contrast.gradient) * contrast.information
            score = contrast.score - contrast.information * np.vecdot(mean - self.mean, contrast.gradient)
            mean, covariance = _conditioned(mean, covariance, gain, score / known, contrast.information / known, clear_view)
        after, gained = self._reweighted(most + np.log(total), mean, covariance)
        levels = hidden.levels(np.einsum("sm,csm->sc", after.weight, share / total))
        chain = self.hidden.copy()
        chain[:, vehicle] = levels
        clear = float(after.weight.sum(axis=1) @ levels[:, 0])
        return replace(after, hidden=chain), gained - REJECTED_COST * fit.exposed.weight * (1.0 - clear)

    def wider(self, factor: float) -> Mixture:
        """Return the track with the variances of the source's place multiplied by a factor; correlations stay."""
        scale = np.ones(self.mean.shape[-1])
        scale[:2] = math.sqrt(factor)
        return replace(self, covariance=self.covariance * scale[:, None] * scale)

    def after_cone(self, scene: Scene, vehicle: int, apex: Vector3, orders: Orders, age_s: float) -> tuple[Mixture, float, float]:
        """Update the track with a Compton cone: probabilistic data association [BST75] over its readings and "no information".

        For each reading k (order of the photon's two interactions), its axis n_k turned by -psi about up, psi the vehicle's
        heading error, u the unit vector to the source, D the distance, T the age of the cone, c = n_k . u:

            delta_k = arccos(c) - theta_k
            h_k = d delta_k / ds = (c u - n_k) / (D sin(alpha)) along x, y and bx, by;  -T times that along vx, vy;
                                   (n_k x u)_z / sin(alpha) along psi;   alpha = arccos(c).

        With L_kj of ``cones`` at V_kj = h_k' P h_k + (c_j sigma_k)^2, the rates R = ``cone_area_mm2`` phi(D) exp(a) E[exp(-t)] of
        the source's cones (at the mean m, without the gain g) and B of the background's:

            w <- w (R (rho + eps) + B) / (R + B), normalised       marginal likelihood
            gamma_kj = L_kj R / (R (rho + eps) + B)                responsibilities; the rest: no information m_kj = m - P h_k
            delta_k / V_kj,   P_kj = P - P h_k h_k' P / V_kj       an EKF update for each

        and the mixture over kj and "no information" (m, P) is replaced by the Gaussian of its moments:

            m <- m + D,   D = -sum_k P h_k sum_j gamma_kj delta_k / V_kj
            P <- P + sum_k P h_k h_k' P sum_j gamma_kj ((delta_k / V_kj)^2 - 1 / V_kj) - D D'.

        vehicle: index. apex: position of the camera, mission frame. orders: the readings. age_s: T. Returns the new track, the
        log Bayes factor of the cone, and the derivative of the log likelihood by psi, mean of the mixture (see ``turned``).
        """
        response, sight = scene.response, LineOfSight.of(self.mean, scene, vehicle, apex, age_s)
        distance = sight.distance
        directions = sight.way / distance[..., None]
        axes = sight.turned(orders.axis, self.mean)  # (S, M, K, 3)
        cosine = np.minimum(np.maximum(np.matvec(axes, directions), -1.0), 1.0)
        sine = np.maximum(np.sqrt(1.0 - cosine * cosine), _MIN_DIRECTION_SINE)
        delta = np.arccos(cosine) - orders.theta_rad
        across = (distance[..., None] * sine)[..., None]
        slope = (cosine[..., None] * directions[..., None, :] - axes) / across  # (S, M, K, 3)
        gradient = sight.gradient(slope, self.mean.shape[-1])  # (S, M, K, d)
        turn = axes[..., 0] * directions[..., None, 1] - axes[..., 1] * directions[..., None, 0]
        heading = BIASES + BIAS * vehicle + HEADING
        gradient[..., heading] = turn / sine
        gain = gradient @ self.covariance  # (S, M, K, d)
        density, precision = orders.density(delta, np.maximum(np.vecdot(gain, gradient), 0.0))  # (S, M, K, 2)
        directed = density.sum(axis=(-2, -1))
        rate = response.cone_area_mm2 * response.flux(distance) * np.exp(self.mean[..., ACTIVITY])
        rate = rate * hidden.passing(self.hidden[:, vehicle])[:, None]
        if scene.buildings:
            rate *= sight.shielding(scene.buildings, apex, self.mean, self.covariance).share
        heard = rate * (directed + OUTLIER_FRACTION) + response.cone_background_ps
        share = density * (rate / heard)[..., None, None]  # gamma
        pull = delta[..., None] * precision
        first = np.vecdot(share, pull)  # (S, M, K)
        second = np.vecdot(share, pull * pull - precision)
        moved = -np.vecmat(first, gain)
        widened = (gain * second[..., None]).swapaxes(-1, -2) @ gain - moved[..., :, None] * moved[..., None, :]
        likelihood = np.log(heard / (rate + response.cone_background_ps))
        score = -float(np.vdot(self.weight, np.vecdot(first, gradient[..., heading])))
        return *self._reweighted(likelihood, self.mean + moved, self.covariance + widened), score

    def _reweighted(self, log_likelihood: Array, mean: Array, covariance: Array) -> tuple[Mixture, float]:
        """Apply Bayes' rule to the weights, given log likelihoods (S, M); also return the log of the sum of weight times
        likelihood.
        """
        most = float(log_likelihood.max())
        weight = self.weight * np.exp(log_likelihood - most)
        total = float(weight.sum())
        after = Mixture(self.time_s, self.mixed_s, weight / total, mean, covariance, self.bias_variance, self.hidden)
        return after, most + float(np.log(total))

    def reduced(self) -> Mixture:
        """Return the track with fewer Gaussians: sites (candidate places) of little weight are dropped, near ones merged
        (``reduction``).
        """
        if len(self.weight) == 1:
            return self
        groups = clusters(self.weight, self.mean, self.covariance)
        if len(groups) == len(self.weight):
            return self
        site = self.weight.sum(axis=1)
        levels = np.stack([np.tensordot(site[each] / site[each].sum(), self.hidden[each], 1) for each in groups])
        weight, mean, covariance = merged(groups, self.weight, self.mean, self.covariance)
        return replace(self, weight=weight, mean=mean, covariance=covariance, hidden=levels)

    def moments(self) -> tuple[Array, Array]:
        """Return mean (d,) and covariance (d, d) of the whole track, over all its Gaussians."""
        d = self.mean.shape[-1]
        return moments_of(self.weight.ravel(), self.mean.reshape(-1, d), self.covariance.reshape(-1, d, d))

    def hedge(self, mean: Array, covariance: Array) -> Array:
        """Return the covariance (2, 2) in m2 to add to the place's when the sum is published as one Gaussian N(m, P),
        ``moments``.

        The published Gaussian then does not exclude a mode of motion that is possible by the sum:

            sum over the modes j with q_j > s^2 of  c_j (P_j + d_j d_j') / s^2,
            d_j = m_j - m,   q_j = d_j' P^-1 d_j,   s = ``_HEDGE_SIGMAS``

        with w_j, m_j, P_j weight, mean and covariance of the mode over all sites; c_j grows from 0 to 1 where w_j grows from one
        to the other ``_POSSIBLE``. A right mode of small weight hardly widens P, which can then exclude the truth
        (docs/faults-found.md: a hovering camera and a walking source).
        """
        place, found = mean[:2], np.zeros((2, 2))
        (xx, xy), (_, yy) = covariance[:2, :2].tolist()
        determinant = max(xx * yy - xy * xy, _MIN_DETERMINANT)
        for mode, weight in enumerate(self.weight.sum(axis=0).tolist()):
            share = min((weight - _POSSIBLE[0]) / (_POSSIBLE[1] - _POSSIBLE[0]), 1.0) / _HEDGE_SIGMAS**2
            if share <= 0.0:
                continue
            at, spread = moments_of(self.weight[:, mode], self.mean[:, mode, :2], self.covariance[:, mode, :2, :2])
            x, y = (away := at - place).tolist()
            if yy * x * x - 2.0 * xy * x * y + xx * y * y > _HEDGE_SIGMAS**2 * determinant:
                found += share * (spread + np.outer(away, away))
        return found

    def moments_at(self, moments: tuple[Array, Array], motion: Motion, time_s: float) -> tuple[Array, Array]:
        """Return mean and covariance at a later time: for less than ``_SHORT_S`` at constant velocity without noise, else
        predicted.

        moments: result of ``moments`` at the time of the state.
        """
        if time_s - self.time_s > _SHORT_S:
            return self.later(motion, time_s).moments()
        mean, covariance = moments[0].copy(), moments[1].copy()
        dt_s = max(0.0, time_s - self.time_s)
        mean[:2] += dt_s * mean[2:4]
        covariance[:2] += dt_s * covariance[2:4]
        covariance[:, :2] += dt_s * covariance[:, 2:4]
        return mean, covariance


def _conditioned(mean: Array, covariance: Array, gain: Array, pull: Array, shrink: Array, share: Array) -> tuple[Array, Array]:
    """Return moments of the Gaussian conditioned with the probability ``share`` (S, M), and otherwise unchanged."""
    moved = share * pull
    wider = share * (pull**2 - shrink) - moved * moved
    return mean + gain * moved[..., None], covariance + (wider[..., None] * gain)[..., :, None] * gain[..., None, :]


def with_variance(bias_variance: Array, vehicle: int, variance: tuple[float, ...]) -> Array:
    """Return the variances (BIAS V,) of the errors of V vehicles, with new values (BIAS,) for one vehicle.

    The argument itself is returned if nothing changes.
    """
    own = slice(BIAS * vehicle, BIAS * (vehicle + 1))
    if tuple(bias_variance[own].tolist()) == variance:
        return bias_variance
    changed = bias_variance.copy()
    changed[own] = variance
    return changed
