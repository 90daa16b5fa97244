"""The track: a Gaussian sum over where the source is, how it moves, how strong it is, and the biases of the vehicles' poses.

Each site of the sum is a pair of Gaussians, for a source at rest and one that moves (an interacting-multiple-model filter). State
of a Gaussian, dimension d = 5 + 3 V: x, y (mission frame, m), their velocities (m/s), log activity (of REFERENCE_BQ), and for
each of the V vehicles the biases of its position (x, y, m) and heading (rad): measured minus true.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agent.frames.transform import Vector3
from agent.fusion.bayes.cones import ASTRAY, Order, cone_likelihood, cone_rate, density
from agent.fusion.bayes.motion import Motion
from agent.fusion.bayes.response import AIR_PER_M, BACKGROUND_PS, CONE_BACKGROUND_PS, fit_rate, flux, signal

Array = NDArray[np.float64]

ACTIVITY = 4  # place of the log activity in the state
BIASES = 5  # and of the first vehicle's
_ROUNDS = 4
_LEAST_WEIGHT = 1e-4  # relative to the heaviest site
_NEAR = 0.5  # sites nearer than this share of their sigma are one


@dataclass(frozen=True, slots=True, eq=False)
class Mixture:
    """weight: (S, 2), mean: (S, 2, d), covariance: (S, 2, d, d); the second index is 0 at rest, 1 moving."""

    time_s: float
    weight: Array
    mean: Array
    covariance: Array

    @staticmethod
    def of_sites(
        time_s: float, weight: Array, x: Array, y: Array, sigma_m: float, log_activity: Array, log_sigma: Array, motion: Motion
    ) -> Mixture:
        """From places (S,) of some weight, all with the same sigma, and what is known of the activity there.

        weight: (S, 2). log_activity, log_sigma: (S,).
        """
        d = BIASES + len(motion.bias_variance)
        mean = np.zeros((len(x), 2, d))
        mean[..., 0], mean[..., 1], mean[..., ACTIVITY] = x[:, None], y[:, None], log_activity[:, None]
        variance = np.zeros((len(x), 2, d))
        variance[..., :2] = sigma_m**2
        variance[:, 1, 2:4] = motion.velocity_variance
        variance[..., ACTIVITY] = (log_sigma**2)[:, None]
        variance[..., BIASES:] = motion.bias_variance
        return Mixture(time_s, weight / weight.sum(), mean, variance[..., None] * np.eye(d))

    def later(self, motion: Motion, time_s: float) -> Mixture:
        """The same at a later time; earlier ones are taken as now."""
        dt_s = time_s - self.time_s
        if dt_s <= 0.0:
            return self
        return Mixture(time_s, *motion.predict(self.weight, self.mean, self.covariance, dt_s))

    def after_counts(self, vehicle: int, position: Vector3, live_time_s: float, counts: Array) -> Mixture:
        """After an exposure of a vehicle (by its place among the biases) with counts (3,), mission frame.

        The logarithm of the rate is linear in the state near each mean; along that direction the counts are fitted.
        """
        x, y, distance = self._seen_from(vehicle, position)
        slope = -(2.0 / distance + AIR_PER_M) / distance
        gain, variance = self._along(vehicle, slope * x, slope * y, activity=1.0)
        expected = signal(flux(distance) * np.exp(self.mean[..., ACTIVITY]) * live_time_s, distance)
        shift, after, likelihood = fit_rate(counts, expected, BACKGROUND_PS * live_time_s, variance, _ROUNDS)
        mean = self.mean + gain * (shift / variance)[..., None]
        shrink = (1.0 - after / variance) / variance
        covariance = self.covariance - shrink[..., None, None] * _outer(gain)
        return self._weighed(np.exp(likelihood - likelihood.max()), mean, covariance)

    def after_cone(self, vehicle: int, apex: Vector3, orders: tuple[Order, ...]) -> Mixture:
        """After a cone: each Gaussian becomes a mixture of what each order says and of the cone saying nothing, and is replaced
        by the Gaussian of the same moments.
        """
        x, y, distance = self._seen_from(vehicle, apex)
        rate = cone_rate(flux(distance) * np.exp(self.mean[..., ACTIVITY]))
        unit = x / distance, y / distance, -apex[2] / distance
        parts = [self._order(vehicle, order, unit, distance) for order in orders]
        directed = sum((part.sum(axis=-1) for part, *_ in parts), np.zeros(rate.shape))
        likelihood = cone_likelihood(rate, directed)
        share = (1.0 / (directed + ASTRAY)) * (1.0 - _background_share(rate, directed))
        moved = np.zeros(self.mean.shape)
        widened = np.zeros(self.covariance.shape)
        for part, gain, delta, variance in parts:
            pull = delta[..., None] / variance
            moved -= gain * (share * np.sum(part * pull, axis=-1))[..., None]
            widened += _outer(gain) * (share * np.sum(part * (pull * pull - 1.0 / variance), axis=-1))[..., None, None]
        return self._weighed(likelihood, self.mean + moved, self.covariance + widened - _outer(moved))

    def _order(
        self, vehicle: int, order: Order, unit: tuple[Array, Array, Array], distance: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Density (S, 2, 2), gain (S, 2, d), angular error (S, 2), its variance with the order's (S, 2, 2)."""
        sx, sy, sz = unit
        heading = self.mean[..., BIASES + 3 * vehicle + 2]
        ax, ay, az = order.axis
        cos, sin = np.cos(heading), np.sin(heading)
        ux, uy = ax * cos + ay * sin, ay * cos - ax * sin
        c = np.clip(ux * sx + uy * sy + az * sz, -0.999999, 0.999999)
        sine = np.sqrt(1.0 - c * c)
        delta = np.arccos(c) - order.theta_rad
        across = distance * sine
        gain, variance = self._along(
            vehicle, -(ux - c * sx) / across, -(uy - c * sy) / across, heading=(ux * sy - uy * sx) / sine
        )
        return density(order, delta, variance), gain, delta, variance[..., None] + order.variance

    def _seen_from(self, vehicle: int, position: Vector3) -> tuple[Array, Array, Array]:
        """x and y from the camera to each mean, and the distance; (S, 2) each."""
        b = BIASES + 3 * vehicle
        x = self.mean[..., 0] - position[0] + self.mean[..., b]
        y = self.mean[..., 1] - position[1] + self.mean[..., b + 1]
        return x, y, np.sqrt(x * x + y * y + position[2] ** 2)

    def _along(
        self, vehicle: int, x: Array, y: Array, activity: float = 0.0, heading: Array | None = None
    ) -> tuple[Array, Array]:
        """P h (S, 2, d) and h P h (S, 2) for the gradient h of a measurement of a vehicle.

        The source's position and the vehicle's bias enter alike: (x, y). Then log activity and heading.
        """
        p, b = self.covariance, BIASES + 3 * vehicle
        gain = x[..., None] * (p[..., 0, :] + p[..., b, :]) + y[..., None] * (p[..., 1, :] + p[..., b + 1, :])
        if activity:
            gain = gain + activity * p[..., ACTIVITY, :]
        if heading is not None:
            gain = gain + heading[..., None] * p[..., b + 2, :]
        variance = x * (gain[..., 0] + gain[..., b]) + y * (gain[..., 1] + gain[..., b + 1])
        if activity:
            variance = variance + activity * gain[..., ACTIVITY]
        if heading is not None:
            variance = variance + heading * gain[..., b + 2]
        return gain, np.maximum(variance, 1e-12)

    def _weighed(self, likelihood: Array, mean: Array, covariance: Array) -> Mixture:
        weight = self.weight * likelihood
        return Mixture(self.time_s, weight / weight.sum(), mean, covariance)

    def reduced(self) -> Mixture:
        """Without sites of hardly any weight, and with sites that lie close together made one (of the same moments)."""
        total = self.weight.sum(axis=1)
        kept = np.flatnonzero(total > _LEAST_WEIGHT * total.max())
        order = kept[np.argsort(-total[kept], kind="stable")]
        if len(order) == 1 == len(total):
            return self
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
        merged = [_moments(self.weight[group], self.mean[group], self.covariance[group]) for group in groups]
        weight = np.array([part[0] for part in merged])
        return Mixture(
            self.time_s, weight / weight.sum(), np.array([part[1] for part in merged]), np.array([part[2] for part in merged])
        )

    def moments(self) -> tuple[Array, Array]:
        """Mean (d,) and covariance (d, d) of all."""
        _, mean, covariance = _moments(
            self.weight.ravel(),
            self.mean.reshape(-1, self.mean.shape[-1]),
            self.covariance.reshape(-1, *self.covariance.shape[-2:]),
        )
        return mean, covariance


def _moments(weight: Array, mean: Array, covariance: Array) -> tuple[Array, Array, Array]:
    """Weight, mean and covariance of a mixture along the first axis."""
    total = np.maximum(weight.sum(axis=0), 1e-300)
    share = weight / total
    middle = np.sum(share[..., None] * mean, axis=0)
    spread = covariance + _outer(mean - middle)
    return total, middle, np.sum(share[..., None, None] * spread, axis=0)


def _outer(vector: Array) -> Array:
    """(..., d) -> (..., d, d)."""
    result: Array = vector[..., :, None] * vector[..., None, :]
    return result


def _background_share(rate: Array, directed: Array) -> Array:
    """Probability that a cone is background."""
    background: Array = CONE_BACKGROUND_PS / (rate * (directed + ASTRAY) + CONE_BACKGROUND_PS)
    return background
