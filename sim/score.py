"""How good an estimator was: its errors against the truth, and whether it lost the source."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

LOST_ERROR_M = 20.0
LOST_ERROR_S = 10.0
Array = NDArray[np.float64]


class Belief(Protocol):
    """What is scored of a hypothesis: mission frame, metres."""

    @property
    def position(self) -> Array:
        """(3,)."""

    @property
    def covariance(self) -> Array:
        """(3, 3)."""


class Score:
    """Errors of one estimator against the truth."""

    def __init__(self, estimator: str) -> None:
        self.estimator = estimator
        self.x0_s: float | None = None
        self.x0_error_m: float | None = None
        self.errors_m: list[float] = []
        self.nees: list[float] = []
        self.lost = False
        self._bad_since_s: float | None = None

    def note_x0(self, time_s: float, belief: Belief | None, source: tuple[float, float]) -> None:
        """Take down when the first hypothesis came, and how good it was."""
        if self.x0_s is None and belief is not None:
            self.x0_s = time_s
            self.x0_error_m = _offset(belief, source)[2]

    def sample(self, time_s: float, belief: Belief | None, source: tuple[float, float]) -> None:
        """One tracking sample; a believer without hypothesis has none."""
        if belief is None:
            return
        dx, dy, error = _offset(belief, source)
        self.errors_m.append(error)
        cov = belief.covariance
        a, b, c = float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1])
        determinant = a * c - b * b
        if determinant > 0.0:
            self.nees.append((c * dx * dx - 2.0 * b * dx * dy + a * dy * dy) / determinant)

    def judge_by_error(self, time_s: float) -> None:
        """Lost when the newest error has been above the limit for long."""
        if not self.errors_m or self.errors_m[-1] <= LOST_ERROR_M:
            self._bad_since_s = None
        elif self._bad_since_s is None:
            self._bad_since_s = time_s
        elif time_s - self._bad_since_s >= LOST_ERROR_S:
            self.lost = True


def _offset(belief: Belief, source: tuple[float, float]) -> tuple[float, float, float]:
    dx, dy = float(belief.position[0]) - source[0], float(belief.position[1]) - source[1]
    return dx, dy, (dx * dx + dy * dy) ** 0.5
