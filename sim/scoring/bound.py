"""The posterior Cramer-Rao bound of a flight: a yardstick for the error of an estimator on the trajectories flown.

Tichavsky, Muravchik, Nehorai: Posterior Cramer-Rao bounds for discrete-time nonlinear filtering. IEEE Trans. Signal Processing
46 (1998) 1386-1396. For linear motion s_k = F s_k-1 + w, w ~ N(0, Q), their recursion for the information matrix,
J_k = D22 - D21 (J_k-1 + D11)^-1 D12 with D11 = F' Q^-1 F, D12 = D21' = -F' Q^-1, D22 = Q^-1 + G_k, is in covariances P = J^-1

    P_k|k-1 = F P_k-1 F' + Q,    P_k = (P_k|k-1^-1 + G_k)^-1 = (I + P_k|k-1 G_k)^-1 P_k|k-1,

where G_k is the Fisher information of the measurements of step k about s_k:

    G_k = sum over vehicles n and samples t of H_n' I_nt H_n dt,

I_nt the information per second (``_information``) about (x, y, ln activity, heading) as vehicle n has them, H_n = ``seen`` the
derivative of those with respect to the state. Deviation from the paper: G_k is taken at the truth of this one flight instead of
its expectation over flights.

State s: x, y, vx, vy of the source, ln activity, and the errors (x, y, yaw) of every vehicle's localisation, by kind: bias,
wander, and the error of the autopilot's filter, each an Ornstein-Uhlenbeck process (a bias is constant). Measurements: counts
(Poisson) and the cones that the mission selects, with ambiguous order, by ``radron.sim.scoring.information``, from the true
positions. Known are the line, the areas, the background, the kind of the source's motion, and the size of the localisation's
errors; not the activity. Not included: tilt, clocks, gains of the cameras, shadows, walls.

Motion: a source at rest has no noise. A moving one has an Ornstein-Uhlenbeck velocity of the same variance and correlation time:
for ``circle`` v^2 / 2 along each axis and radius / v; for ``wander`` see ``_wandering``. Such a source could go anywhere; an
estimator that knew the circle could do better than the bound, which is therefore no strict limit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import erf

from radron.sim.geometry import Array
from radron.sim.radiation.truth import CameraTruth
from radron.sim.scoring.information import Camera, camera_of
from radron.sim.world.localization import LocalizationTruth
from radron.sim.world.source import STRETCH_S, TURN_RPS
from radron.sim.world.sourcetruth import SourceTruth

BOUND_STEP_S = 1.0
LOG_ACTIVITY_SIGMA = 3.0  # prior of ln activity: a factor of 20 up or down
_SOURCE = 5  # dimensions of the state before the vehicles' errors


@dataclass(frozen=True, slots=True)
class Bound:
    """Lower bounds of the covariance of the source position error after each of K time steps, for N vehicles, in m2.

    time_s: (K,). true: (K, 2, 2) for the error against the source's true place. own: (K, N, 2, 2) for the error against the place
    at which a vehicle with its localisation error would see the source (true place plus localisation error).
    """

    time_s: Array
    true: Array
    own: Array

    def over(self, time_s: Array) -> Array:
        """Return the bound of the median position error (m), interpolated to other times (T,); NaN before the first step.

        It is the median length of a Gaussian error with the covariance ``true``.
        """
        return self._interpolated(time_s, self.true)

    def own_over(self, time_s: Array) -> Array:
        """Return the bound of the median error (m) of the source's place as the first vehicle would see it.

        The bound is interpolated to the times (T,); NaN before the first step.
        """
        return self._interpolated(time_s, self.own[:, 0])

    def _interpolated(self, time_s: Array, covariance: Array) -> Array:
        if not len(self.time_s):
            return np.full(time_s.shape, np.nan)
        return np.interp(time_s, self.time_s, median_error(covariance), left=np.nan)

    def median_m(self, during: NDArray[np.bool_]) -> float | None:
        """Return the bound of the median position error (m): a median over the selected time steps (K,); None without steps."""
        return float(np.median(median_error(self.true[during]))) if during.any() else None

    def own_median_m(self, during: NDArray[np.bool_]) -> float | None:
        """Return the bound of the median error (m) of the source's place as the vehicles would see it.

        The result is a median over the selected time steps (K,) and all vehicles; None without steps.
        """
        return float(np.median(median_error(self.own[during]))) if during.any() else None


def bound_of(
    source: SourceTruth,
    camera: CameraTruth,
    minimum_pixels: int,
    localization: LocalizationTruth,
    sides_m: tuple[float, float],
    time_s: Array,
    position_m: Array,
    source_m: Array,
) -> Bound:
    """Compute the lower bound of the source position error for a flight, from its true trajectories.

    T samples, N vehicles.

    Args:
        source, camera, localization: the truth.
        minimum_pixels: smallest number of pixels of the events that become cones.
        sides_m: sides of the area of possible sources; the prior variance of each axis is side^2 / 12.
        time_s: (T,) evenly spaced.
        position_m: (T, N, 3) of the vehicles.
        source_m: (T, 3) of the source.
    """
    sample_s = float(time_s[1] - time_s[0]) if len(time_s) > 1 else BOUND_STEP_S
    block = max(1, round(BOUND_STEP_S / sample_s))
    steps = len(time_s) // block
    used = slice(0, steps * block)
    counting = camera_of(camera, source.nuclide, minimum_pixels)
    information = _information(counting, source.activity_bq, position_m[used], source_m[used]) * sample_s
    information = information.reshape(steps, block, *information.shape[1:]).sum(axis=1)
    model = _Model.of(source, localization, position_m.shape[1], sides_m, sample_s * block)
    gained = np.einsum("nia,knij,njb->kab", model.seen, information, model.seen)
    covariance = model.prior
    identity = np.eye(len(covariance))
    true, own = np.empty((steps, 2, 2)), np.empty((steps, position_m.shape[1], 2, 2))
    for step in range(steps):
        covariance = model.step @ covariance @ model.step.T + model.noise
        covariance = np.linalg.solve(identity + covariance @ gained[step], covariance)
        covariance = 0.5 * (covariance + covariance.T)
        true[step] = covariance[:2, :2]
        own[step] = model.seen[:, :2] @ covariance @ model.seen[:, :2].transpose(0, 2, 1)
    return Bound(time_s[block - 1 : steps * block : block], true, own)


@dataclass(frozen=True, slots=True)
class _Model:
    """step: F, noise: Q, prior: P_0, (d, d) each. seen: (N, 4, d) H_n, from the state to what vehicle n has as its (x, y,
    ln activity, heading): (x + sum of e_x, y + sum of e_y, ln activity, sum of e_yaw) over the kinds of errors.

    Per axis of the source, with r = exp(-dt / tau): x <- x + tau (1 - r) v, v <- r v, Q_vv = s2 (1 - r^2),
    Q_xv = s2 tau (1 - r)^2, Q_xx = s2 tau (2 dt - tau (3 - 4 r + r^2)), s2 the variance and tau the correlation time of the
    velocity. Each error: F = exp(-dt / tau_e), Q = (1 - F^2) P_0.
    """

    step: Array
    noise: Array
    prior: Array
    seen: Array

    @staticmethod
    def of(source: SourceTruth, errors: LocalizationTruth, vehicles: int, sides_m: tuple[float, float], step_s: float) -> _Model:
        variance, turning_s = _motion(source)
        keep = math.exp(-step_s / turning_s)
        moved = turning_s * (1.0 - keep)
        place = variance * turning_s * (2.0 * step_s - turning_s * (3.0 - 4.0 * keep + keep**2))
        both = variance * turning_s * (1.0 - keep) ** 2
        kinds = [
            (errors.bias_m, math.radians(errors.bias_yaw_deg), 1.0),
            (errors.wander_m / 2.0**0.5, math.radians(errors.yaw_deg), math.exp(-step_s / errors.correlation_s)),
            # The filter's error is of second order; an approximation of first order has the same mean memory.
            (errors.horizontal_m / 2.0**0.5, 0.0, math.exp(-step_s / (2.0 * errors.filter_s))),
        ]
        kinds = [kind for kind in kinds if kind[0] > 0.0 or kind[1] > 0.0]
        size = _SOURCE + 3 * vehicles * len(kinds)
        step, noise, prior = np.eye(size), np.zeros((size, size)), np.zeros((size, size))
        for axis in range(2):
            speed = axis + 2
            step[axis, speed], step[speed, speed] = moved, keep
            noise[axis, axis], noise[speed, speed] = place, variance * (1.0 - keep**2)
            noise[axis, speed] = noise[speed, axis] = both
            prior[axis, axis], prior[speed, speed] = sides_m[axis] ** 2 / 12.0, variance
        prior[4, 4] = LOG_ACTIVITY_SIGMA**2
        seen = np.zeros((vehicles, 4, size))
        seen[:, (0, 1, 2), (0, 1, 4)] = 1.0
        for number, (position, yaw, kept) in enumerate(kinds):
            for vehicle in range(vehicles):
                first = _SOURCE + 3 * (vehicle * len(kinds) + number)
                own = np.arange(first, first + 3)
                prior[own, own] = position**2, position**2, yaw**2
                step[own, own] = kept
                noise[own, own] = (1.0 - kept**2) * prior[own, own]
                seen[vehicle, (0, 1, 3), own] = 1.0
        return _Model(step, noise, prior, seen)


def _motion(source: SourceTruth) -> tuple[float, float]:
    """Return the variance of the velocity along each axis, m2/s2, and its correlation time, s."""
    if source.motion == "static" or source.speed_mps == 0.0:
        return 0.0, 1.0
    if source.motion == "circle":
        return source.speed_mps**2 / 2.0, source.circle_radius_m / source.speed_mps
    return _wandering(source)


def _wandering(source: SourceTruth) -> tuple[float, float]:
    """Return the variance and correlation time of a wandering source's velocity.

    Speeds are uniform between s v and v: mean square v^2 (1 + s + s^2) / 3, half of it along each axis. Half of the stretches
    turn, at a rate uniform up to w, for a time T: the variance of the heading grows by h = w^2 E[T^2] / 6 per stretch of
    duration E[T], and the velocity's correlation time is 2 E[T] / h. The jumps of the speed between stretches are left out:
    they add a tenth of that noise.
    """
    low, high = STRETCH_S
    mean_s, square_s2 = (low + high) / 2.0, (low**2 + low * high + high**2) / 3.0
    spread = TURN_RPS**2 * square_s2 / 6.0
    s = source.slowest
    return source.speed_mps**2 * (1.0 + s + s * s) / 6.0, 2.0 * mean_s / spread


def _information(camera: Camera, activity_bq: float, position_m: Array, source_m: Array) -> Array:
    """(T, N, 4, 4) I_nt: Fisher information per second about (x, y, ln activity, heading) as vehicle n has them.

    With u the unit vector from camera to source, D the distance, c = (u_x, u_y) = dD/d(x, y): counts

        [[ I_DD c c',  I_Da c ], [ I_Da c',  I_aa ]]        ``Camera.counts``

    and cones: J' J I_cone with J (3, 3) the derivative of the direction u in the vehicle's frame: (I - u u') / D along x and y,
    (-u_y, u_x, 0) along the heading (``turns``); I_cone = ``Camera.cones``, rad^-2 for each of the two angles.
    """
    line = source_m[:, None, :] - position_m
    distance = np.maximum(np.linalg.norm(line, axis=2), 0.1)
    unit = line / distance[..., None]
    result = np.zeros((*distance.shape, 4, 4))
    far, both, strength = camera.counts(activity_bq, distance)
    along = unit[..., :2]
    result[..., :2, :2] = far[..., None, None] * along[..., :, None] * along[..., None, :]
    result[..., :2, 2] = result[..., 2, :2] = both[..., None] * along
    result[..., 2, 2] = strength
    # J: (T, N, 3, 3), from x, y and heading to the direction.
    turns = np.zeros((*distance.shape, 3, 3))
    turns[..., :2] = (np.eye(3) - unit[..., :, None] * unit[..., None, :])[..., :2] / distance[..., None, None]
    turns[..., 0, 2], turns[..., 1, 2] = -unit[..., 1], unit[..., 0]
    cones = camera.cones(activity_bq, distance)[..., None, None] * (np.swapaxes(turns, -1, -2) @ turns)
    rows, columns = np.ix_((0, 1, 3), (0, 1, 3))
    result[..., rows, columns] += cones
    return result


def median_error(covariance: Array) -> Array:
    """Return the median length of a Gaussian error with zero mean and covariance C, for an array of covariances (..., 2, 2)."""
    variances = np.maximum(np.linalg.eigvalsh(covariance), 0.0)
    large = variances[..., 1]
    ratio = np.divide(variances[..., 0], large, out=np.zeros_like(large), where=large > 0.0)
    result: Array = np.sqrt(large) * np.interp(ratio, *_medians())
    return result


@cache
def _medians() -> tuple[Array, Array]:
    """Return the median length of an error with variances 1 and q, tabulated over q from 0 to 1."""
    ratios = np.linspace(0.0, 1.0, 41) ** 2

    def beyond(length: float, ratio: float) -> float:
        """P(error shorter than length) - 1/2: the integral over the first component of P(second is small enough)."""
        angle = np.linspace(0.0, np.pi / 2.0, 400)
        first, left = length * np.sin(angle), length * np.cos(angle)
        shorter = erf(left / math.sqrt(2.0 * ratio)) if ratio > 0.0 else np.ones_like(left)
        inside = np.trapezoid(math.sqrt(2.0 / math.pi) * np.exp(-0.5 * first**2) * shorter * left, angle)
        return float(inside) - 0.5

    return ratios, np.array([brentq(beyond, 0.1, 3.0, args=(ratio,)) for ratio in ratios.tolist()])
