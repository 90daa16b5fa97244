"""How wrong the vehicles' own localisation is: slowly wandering position and heading errors, and velocity noise."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

Array = NDArray[np.float64]


class LocalizationTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """1-sigma errors. Defaults: a real PX4's EKF against the truth."""

    horizontal_m: float = 0.13  # of the horizontal distance; each axis has 1/sqrt(2) of it
    vertical_m: float = 0.2
    yaw_deg: float = 1.0
    correlation_s: float = 20.0
    velocity_mps: float = 0.05  # white


class Localization:
    """Errors of N vehicles (estimate minus truth), first-order Gauss-Markov, advanced in fixed steps."""

    def __init__(self, truth: LocalizationTruth, count: int, step_s: float, rng: np.random.Generator) -> None:
        horizontal = truth.horizontal_m / 2.0**0.5
        self._sigma = np.array([horizontal, horizontal, truth.vertical_m, np.deg2rad(truth.yaw_deg)])
        self._keep = float(np.exp(-step_s / truth.correlation_s))
        self._velocity_mps = truth.velocity_mps
        self._rng = rng
        self._error = self._sigma * rng.standard_normal((count, 4))
        self.velocity_error_mps: Array = np.zeros((count, 3))

    @property
    def position_error_m(self) -> Array:
        """(N, 3), world axes."""
        return self._error[:, :3]

    @property
    def yaw_error_rad(self) -> Array:
        """(N,)."""
        return self._error[:, 3]

    def step(self) -> None:
        """Advance one time step."""
        noise = self._rng.standard_normal((len(self._error), 7))
        self._error *= self._keep
        self._error += (1.0 - self._keep**2) ** 0.5 * self._sigma * noise[:, :4]
        self.velocity_error_mps = self._velocity_mps * noise[:, 4:]
