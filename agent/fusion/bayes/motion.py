"""How the state of the track changes with time: at rest or moving, and slowly wandering biases of the vehicles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ACTIVITY = 4  # place of the log activity in the state
BIASES = 5  # and of the first vehicle's biases:
BIAS = 4  # x, y (m), heading (rad), log of the camera's gain


@dataclass(frozen=True, slots=True)
class Motion:
    """A source that moves has an Ornstein-Uhlenbeck velocity; at ``switch_ps`` it stops, or one at rest starts.

    A vehicle's biases wander within what is known of them: by ``bias_drift`` (BIAS,), variance per second of each.
    """

    velocity_variance: float  # of each axis, m2/s2
    velocity_s: float
    switch_ps: float
    bias_drift: Array

    def predict(self, mean: Array, covariance: Array, bias_variance: Array, dt_s: float) -> tuple[Array, Array]:
        """Means (S, 2, d) and covariances (S, 2, d, d) after dt_s; bias_variance: (BIAS V,), at all times."""
        keep = float(np.exp(-dt_s / self.velocity_s))
        reach = self.velocity_s * (1.0 - keep)
        drift = np.tile(self.bias_drift, len(bias_variance) // BIAS)
        fade = np.exp(-0.5 * dt_s * drift / np.maximum(bias_variance, 1e-30))
        carry = np.zeros((2, mean.shape[-1]))  # factors of each of the state's numbers, at rest and moving
        carry[:, :BIASES] = 1.0
        carry[0, 2:4], carry[1, 2:4] = 0.0, keep
        carry[:, BIASES:] = fade
        mean, covariance = mean * carry, covariance * (carry[:, :, None] * carry[:, None, :])
        # What the velocity was before it faded moves the source: reach / keep of what is left of it.
        moving, spread, step = mean[:, 1], covariance[:, 1], reach / keep
        moving[:, :2] += step * moving[:, 2:4]
        spread[:, :2] += step * spread[:, 2:4]
        spread[:, :, :2] += step * spread[:, :, 2:4]
        kick = self.velocity_variance * (1.0 - keep * keep)
        noise = np.zeros((2, mean.shape[-1]))
        noise[:, BIASES:] = (1.0 - fade * fade) * bias_variance
        noise[1, :2], noise[1, 2:4] = kick * dt_s * dt_s / 3.0, kick
        places = np.arange(mean.shape[-1])
        covariance[..., places, places] += noise
        for axis in (0, 1):
            spread[:, axis, 2 + axis] += kick * dt_s / 2.0
            spread[:, 2 + axis, axis] += kick * dt_s / 2.0
        return mean, covariance

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
