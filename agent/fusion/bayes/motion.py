"""How the state of the track changes with time: at rest or moving, and slowly wandering biases of the vehicles."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ACTIVITY = 4  # place of the log activity in the state
BIASES = 5  # and of the first vehicle's biases:
BIAS = 4  # x, y (m), heading (rad), log of the camera's gain


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A source that moves has an Ornstein-Uhlenbeck velocity; at ``switch_ps`` it stops, or one at rest starts.

    A vehicle's biases wander within what is known of them: by ``bias_drift`` (BIAS,), variance per second of each.
    """

    velocity_variance: float  # of each axis, m2/s2
    velocity_s: float
    switch_ps: float
    bias_drift: Array

    def predict(self, mean: Array, covariance: Array, bias_variance: Array, dt_ms: int) -> tuple[Array, Array]:
        """Means (S, 2, d) and covariances (S, 2, d, d) after dt_ms; bias_variance: (BIAS V,), at all times."""
        transition, noise = _transition(self, bias_variance.tobytes(), dt_ms)
        moved = (transition @ mean[..., None])[..., 0]
        return moved, transition @ covariance @ transition.swapaxes(-1, -2) + noise

    def switch(self, weight: Array, mean: Array, covariance: Array, dt_s: float) -> tuple[Array, Array, Array]:
        """Mix the two Gaussians of each site, of moments alike (interacting multiple models), after dt_s."""
        chance = -float(np.expm1(-self.switch_ps * dt_s))
        came = mean[:, ::-1].copy()  # what was in the other mode, as it begins in this one
        came[:, :, 2:4] = 0.0
        with_it = covariance[:, ::-1].copy()
        with_it[:, :, 2:4, :] = 0.0
        with_it[:, :, :, 2:4] = 0.0
        with_it[:, 1, [2, 3], [2, 3]] = self.velocity_variance
        moved = chance * weight[:, ::-1]
        total = (1.0 - chance) * weight + moved
        share = (moved / np.maximum(total, 1e-300))[..., None]
        apart = came - mean
        spread = (share * (1.0 - share))[..., None] * (apart[..., :, None] * apart[..., None, :])
        return total, mean + share * apart, covariance + share[..., None] * (with_it - covariance) + spread


@lru_cache(maxsize=256)
def _transition(motion: Motion, biases: bytes, dt_ms: int) -> tuple[Array, Array]:
    """Transition matrices and covariances of the noise, (2, d, d) each, at rest and moving."""
    dt_s = 1e-3 * dt_ms
    bias_variance = np.frombuffer(biases)
    d = BIASES + len(bias_variance)
    drift = np.tile(motion.bias_drift, len(bias_variance) // BIAS)
    fade = np.exp(-0.5 * dt_s * drift / np.maximum(bias_variance, 1e-30))
    keep = float(np.exp(-dt_s / motion.velocity_s))
    kick = motion.velocity_variance * (1.0 - keep * keep)
    transition, noise = np.zeros((2, d, d)), np.zeros((2, d, d))
    for k in (0, 1, ACTIVITY):
        transition[:, k, k] = 1.0
    for x, v in ((0, 2), (1, 3)):
        transition[1, x, v], transition[1, v, v] = motion.velocity_s * (1.0 - keep), keep
        noise[1, x, x], noise[1, v, v] = kick * dt_s * dt_s / 3.0, kick
        noise[1, x, v] = noise[1, v, x] = kick * dt_s / 2.0
    places = np.arange(BIASES, d)
    transition[:, places, places] = fade
    noise[:, places, places] = (1.0 - fade * fade) * bias_variance
    return transition, noise
