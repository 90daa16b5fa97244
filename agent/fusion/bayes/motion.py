"""How the state of the track changes with time: at rest or moving, and slowly wandering biases."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Motion:
    """A source that moves has an Ornstein-Uhlenbeck velocity; at ``switch_ps`` it stops, or one at rest starts.

    bias_variance: (3 V,) of the vehicles' biases; they wander within it, with a correlation time of ``bias_s``.
    """

    velocity_variance: float  # of each axis, m2/s2
    velocity_s: float
    switch_ps: float
    bias_variance: Array
    bias_s: float

    def predict(self, weight: Array, mean: Array, covariance: Array, dt_s: float) -> tuple[Array, Array, Array]:
        """Weights (S, 2), means (S, 2, d) and covariances (S, 2, d, d) after dt_s."""
        weight, mean, covariance = self._switched(weight, mean, covariance, -float(np.expm1(-self.switch_ps * dt_s)))
        self._move(mean[:, 1], covariance[:, 1], dt_s)
        self._wander(mean, covariance, dt_s)
        return weight, mean, covariance

    def _switched(self, weight: Array, mean: Array, covariance: Array, chance: float) -> tuple[Array, Array, Array]:
        """Mix the two Gaussians of each site, of moments alike (interacting multiple models)."""
        starting = mean[:, 0], covariance[:, 0].copy()
        starting[1][:, [2, 3], [2, 3]] += self.velocity_variance
        stopping = mean[:, 1].copy(), covariance[:, 1].copy()
        stopping[0][:, 2:4] = 0.0
        stopping[1][:, 2:4, :] = 0.0
        stopping[1][:, :, 2:4] = 0.0
        moved = chance * weight
        rest = _mixed(weight[:, 0] - moved[:, 0], mean[:, 0], covariance[:, 0], moved[:, 1], *stopping)
        moving = _mixed(weight[:, 1] - moved[:, 1], mean[:, 1], covariance[:, 1], moved[:, 0], *starting)
        return tuple(np.stack(pair, axis=1) for pair in zip(rest, moving, strict=True))  # type: ignore[return-value]

    def _move(self, mean: Array, covariance: Array, dt_s: float) -> None:
        """Carry means (S, d) and covariances (S, d, d) of moving sources on, in place."""
        keep = float(np.exp(-dt_s / self.velocity_s))
        reach = self.velocity_s * (1.0 - keep)
        mean[:, :2] += reach * mean[:, 2:4]
        mean[:, 2:4] *= keep
        for rows in (covariance, covariance.transpose(0, 2, 1)):
            rows[:, :2] += reach * rows[:, 2:4]
            rows[:, 2:4] *= keep
        kick = self.velocity_variance * (1.0 - keep * keep)
        for axis in (0, 1):
            covariance[:, 2 + axis, 2 + axis] += kick
            covariance[:, axis, axis] += kick * dt_s * dt_s / 3.0
            covariance[:, axis, 2 + axis] += kick * dt_s / 2.0
            covariance[:, 2 + axis, axis] += kick * dt_s / 2.0

    def _wander(self, mean: Array, covariance: Array, dt_s: float) -> None:
        keep = float(np.exp(-dt_s / self.bias_s))
        first = mean.shape[-1] - len(self.bias_variance)
        mean[..., first:] *= keep
        covariance[..., first:, :] *= keep
        covariance[..., :, first:] *= keep
        places = np.arange(first, mean.shape[-1])
        covariance[..., places, places] += (1.0 - keep * keep) * self.bias_variance


def _mixed(
    weight: Array, mean: Array, covariance: Array, other_weight: Array, other_mean: Array, other_covariance: Array
) -> tuple[Array, Array, Array]:
    """The Gaussian with the moments of two, for each site."""
    total = weight + other_weight
    share = (other_weight / np.maximum(total, 1e-300))[:, None]
    apart = other_mean - mean
    spread = (share * (1.0 - share))[..., None] * apart[:, :, None] * apart[:, None, :]
    return total, mean + share * apart, covariance + share[..., None] * (other_covariance - covariance) + spread
