"""How the state of the track changes with time: the source rests, walks or runs, and the vehicles' biases wander slowly."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Array = NDArray[np.float64]

ACTIVITY = 4  # place of the log activity in the state
BIASES = 5  # and of the first vehicle's biases:
BIAS = 4  # x, y (m), heading (rad), log of the camera's gain
HEADING, GAIN = 2, 3
REST = 0  # the first of the modes


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """The ways in which a source may move, M modes: at rest, and with Ornstein-Uhlenbeck velocities.

    velocity_variance (M,): of each axis, m2/s2; 0 at rest. velocity_s (M,): correlation time. change_ps (M, M): rate at which a
    source goes over from one mode to another. A vehicle's biases wander within what is known of them: by ``bias_drift`` (BIAS,),
    variance per second of each.
    """

    velocity_variance: Array
    velocity_s: Array
    change_ps: Array
    bias_drift: Array

    @property
    def modes(self) -> int:
        """M."""
        return len(self.velocity_variance)

    def predict(self, mean: Array, covariance: Array, bias_variance: Array, dt_ms: int) -> tuple[Array, Array]:
        """Means (S, M, d) and covariances (S, M, d, d) after dt_ms; bias_variance: (BIAS V,), at all times."""
        transition, noise = _transition(self, bias_variance.tobytes(), dt_ms)
        moved = (transition @ mean[..., None])[..., 0]
        return moved, transition @ covariance @ transition.swapaxes(-1, -2) + noise

    def switch(self, weight: Array, mean: Array, covariance: Array, dt_s: float) -> tuple[Array, Array, Array]:
        """Mix the Gaussians of each site, of moments alike (interacting multiple models), after dt_s."""
        moved = weight[:, :, None] * _chances(self, round(1e3 * dt_s))  # (S, from, to)
        total = moved.sum(axis=1)
        share = moved / np.maximum(total, 1e-300)[:, None, :]
        means = np.repeat(mean[:, :, None], self.modes, axis=2)  # (S, from, to, d)
        spreads = np.repeat(covariance[:, :, None], self.modes, axis=2)
        for parts in ((slice(REST + 1, None), REST), (REST, slice(REST + 1, None))):  # who stops or starts, forgets its velocity
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
def _chances(motion: Motion, dt_ms: int) -> Array:
    """Probabilities (M, M) of having gone over from one mode to another."""
    rates = motion.change_ps - np.diag(motion.change_ps.sum(axis=1))
    result: Array = expm(1e-3 * dt_ms * rates)
    return result


@lru_cache(maxsize=256)
def _transition(motion: Motion, biases: bytes, dt_ms: int) -> tuple[Array, Array]:
    """Transition matrices and covariances of the noise, (M, d, d) each."""
    dt_s = 1e-3 * dt_ms
    bias_variance = np.frombuffer(biases)
    d = BIASES + len(bias_variance)
    drift = np.tile(motion.bias_drift, len(bias_variance) // BIAS)
    fade = np.exp(-0.5 * dt_s * drift / np.maximum(bias_variance, 1e-30))
    keep = np.exp(-dt_s / motion.velocity_s)
    kick = motion.velocity_variance * (1.0 - keep * keep)
    swept = motion.velocity_s * (dt_s - motion.velocity_s * (2.0 * (1.0 - keep) - 0.5 * (1.0 - keep * keep)))
    transition, noise = np.zeros((motion.modes, d, d)), np.zeros((motion.modes, d, d))
    transition[:, [0, 1, ACTIVITY], [0, 1, ACTIVITY]] = 1.0
    for x, v in ((0, 2), (1, 3)):
        transition[:, x, v], transition[:, v, v] = motion.velocity_s * (1.0 - keep), keep
        noise[:, x, x], noise[:, v, v] = 2.0 * motion.velocity_variance * swept, kick
        noise[:, x, v] = noise[:, v, x] = motion.velocity_variance * motion.velocity_s * (1.0 - keep) ** 2
    transition[REST, :, 2:4] = 0.0
    places = np.arange(BIASES, d)
    transition[:, places, places] = fade
    noise[:, places, places] = (1.0 - fade * fade) * bias_variance
    return transition, noise
