"""The motion model of the track: the source rests, walks or runs (M = 3 modes), and the vehicles' biases drift slowly.

Symbols of the equations and their names here: s the state (x, y, vx, vy, a, biases of vehicle 1, .., biases of vehicle V),
a = ln(activity / REFERENCE_BQ); tau = ``velocity_s``, sigma_v^2 = ``velocity_variance``, Q = ``switching_ps`` with its
diagonal filled, q = ``bias_drift``, P0 = ``bias_variance``. References: radron.agent.fusion.bayes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from scipy.linalg import expm

from radron.agent.geometry import Array

ACTIVITY = 4  # index of the log activity in the state
BIASES = 5  # index of the first vehicle's biases:
BIAS = 4  # x, y (m), heading (rad), log of the camera's gain
HEADING, GAIN = 2, 3
REST = 0  # the first of the modes
SCATTER, HEIGHT = -2, -1  # over soil, the last two of the state: log scatter factor, height above the ground (m)


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """The motion model of the source: at rest, or moving with a velocity that fluctuates around 0 (Ornstein-Uhlenbeck process
    [UO30]).

    The source is in one of M modes. In a moving mode each axis of the velocity v obeys dv = -(v / tau) dt + sqrt(2 sigma_v^2 /
    tau) dW:
    Singer's model [S70] with the velocity in place of the acceleration. The velocity is stationary with N(0, sigma_v^2) and the
    autocorrelation exp(-|t| / tau).

    velocity_variance: (M,) sigma_v^2 of each axis, m2/s2; 0 at rest. velocity_s: (M,) correlation time tau. switching_ps: (M, M)
    rates of the Markov chain of the modes, per second, from row to column, diagonal 0. bias_drift: (BIAS,) q, variance per second
    of a vehicle's position, heading and gain errors (biases), for times short against 2 P0 / q, P0 their stationary variance.
    ground_variance: (2,) prior variances of the soil's scatter factor (log) and of the source's height (m2), both constant, or
    (0,) if nothing is assumed below the source.
    """

    velocity_variance: Array
    velocity_s: Array
    switching_ps: Array
    bias_drift: Array
    ground_variance: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def modes(self) -> int:
        """Number M of motion modes of the source."""
        return len(self.velocity_variance)

    def predict(self, mean: Array, covariance: Array, bias_variance: Array, dt_ms: int) -> tuple[Array, Array]:
        """Predict the Gaussians of the source's state by a time dt_ms within each motion mode: m <- F m, P <- F P F' + W.

        mean: (S, M, d) m of S sites (candidate places), M modes and d state variables. covariance: (S, M, d, d) P. bias_variance:
        (BIAS V,) stationary variances P0 of the biases of V vehicles. F and W: transition matrix and noise.
        """
        transition, noise = _transition(self, bias_variance.tobytes(), dt_ms)
        moved = (transition @ mean[..., None])[..., 0]
        return moved, transition @ covariance @ transition.swapaxes(-1, -2) + noise

    def mix(self, weight: Array, mean: Array, covariance: Array, dt_s: float) -> tuple[Array, Array, Array]:
        """Account for switches of the motion mode in the last dt_s: the interaction step of the IMM filter [BBS88], within each
        site.

        A site is one candidate place of the source. With pi_ij(dt) = P(mode j now | mode i dt ago) = [expm(Q dt)]_ij, Q the
        switching rates, for each site with joint weights w_i, means m_i and covariances P_i of its modes:

            c_j = sum_i w_i pi_ij                          new weight of mode j
            mu_i|j = w_i pi_ij / c_j                       mixing probabilities
            m0_j = sum_i mu_i|j m_ij                       mixed mean
            P0_j = sum_i mu_i|j (P_ij + (m_ij - m0_j) (m_ij - m0_j)')

        m_ij and P_ij are m_i and P_i, except for the velocity of a source that stops or starts. For i -> rest the velocity is 0
        without variance, for rest -> j it is N(0, sigma_v,j^2), both uncorrelated with the rest of the state.

        weight: (S, M) for S sites and M modes. mean: (S, M, d). covariance: (S, M, d, d). Returns c, m0 and P0 of these shapes.
        """
        moved = weight[:, :, None] * _mode_transition(self, round(1e3 * dt_s))  # (S, from, to)
        total = moved.sum(axis=1)
        share = moved / np.maximum(total, 1e-300)[:, None, :]
        means = np.repeat(mean[:, :, None], self.modes, axis=2)  # (S, from, to, d)
        spreads = np.repeat(covariance[:, :, None], self.modes, axis=2)
        for parts in ((slice(REST + 1, None), REST), (REST, slice(REST + 1, None))):  # a source that stops or starts
            means[(slice(None), *parts, slice(2, 4))] = 0.0
            spreads[(slice(None), *parts, slice(2, 4))] = 0.0
            spreads[(slice(None), *parts, slice(None), slice(2, 4))] = 0.0
        for axis in (2, 3):
            spreads[:, REST, REST + 1 :, axis, axis] = self.velocity_variance[REST + 1 :]
        middle = (share[..., None] * means).sum(axis=1)
        apart = means - middle[:, None]
        spreads += apart[..., :, None] * apart[..., None, :]
        return total, middle, (share[..., None, None] * spreads).sum(axis=1)


@lru_cache(maxsize=256)
def _mode_transition(motion: Motion, dt_ms: int) -> Array:
    """Return (M, M): pi(dt) = expm(Q dt), from row to column; Q = switching_ps - diag(its row sums), the chain's generator."""
    rates = motion.switching_ps - np.diag(motion.switching_ps.sum(axis=1))
    result: Array = expm(1e-3 * dt_ms * rates)
    return result


@lru_cache(maxsize=256)
def _transition(motion: Motion, biases: bytes, dt_ms: int) -> tuple[Array, Array]:
    """Transition matrices F and noise covariances W, (M, d, d) each, over t = dt_ms; exact integrals of the models.

    Source, for each axis, with r = exp(-t / tau):

        x <- x + tau (1 - r) v,   v <- r v,   a <- a
        W_vv = sigma_v^2 (1 - r^2)
        W_xv = sigma_v^2 tau (1 - r)^2
        W_xx = sigma_v^2 tau (2 t - tau (3 - 4 r + r^2))

    At rest v <- 0, and no noise. Each bias b is an Ornstein-Uhlenbeck process of stationary variance P0 and correlation time
    2 P0 / q: with f = exp(-q t / (2 P0)), b <- f b and W_bb = (1 - f^2) P0, which is q t for short times.
    """
    dt_s = 1e-3 * dt_ms
    bias_variance = np.frombuffer(biases)
    biases_end = BIASES + len(bias_variance)
    d = biases_end + len(motion.ground_variance)
    drift = np.tile(motion.bias_drift, len(bias_variance) // BIAS)
    bias_decay = np.exp(-0.5 * dt_s * drift / np.maximum(bias_variance, 1e-30))
    decay = np.exp(-dt_s / motion.velocity_s)
    velocity_noise = motion.velocity_variance * (1.0 - decay * decay)
    half_s2 = motion.velocity_s * (dt_s - motion.velocity_s * (2.0 * (1.0 - decay) - 0.5 * (1.0 - decay * decay)))
    transition, noise = np.zeros((motion.modes, d, d)), np.zeros((motion.modes, d, d))
    transition[:, [0, 1, ACTIVITY], [0, 1, ACTIVITY]] = 1.0
    for x, v in ((0, 2), (1, 3)):
        transition[:, x, v], transition[:, v, v] = motion.velocity_s * (1.0 - decay), decay
        noise[:, x, x], noise[:, v, v] = 2.0 * motion.velocity_variance * half_s2, velocity_noise
        noise[:, x, v] = noise[:, v, x] = motion.velocity_variance * motion.velocity_s * (1.0 - decay) ** 2
    transition[REST, :, 2:4] = 0.0
    transition[:, range(biases_end, d), range(biases_end, d)] = 1.0
    places = np.arange(BIASES, biases_end)
    transition[:, places, places] = bias_decay
    noise[:, places, places] = (1.0 - bias_decay * bias_decay) * bias_variance
    return transition, noise
