"""Score of an estimator: errors against the truth, consistency of its covariance, and whether it lost the source."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from radron.sim.geometry import Array

LOST_ERROR_M = 20.0
LOST_ERROR_S = 10.0


class Seen(Protocol):
    """Position of the source by a drone's own localisation."""

    @property
    def position(self) -> Array:
        """(3,) mission frame, metres."""


class Belief(Protocol):
    """The scored part of a hypothesis: mission frame, metres."""

    @property
    def position(self) -> Array:
        """(3,)."""

    @property
    def covariance(self) -> Array:
        """(3, 3)."""

    @property
    def activity_bq(self) -> float | None:
        """Activity; None from an estimator without one."""

    @property
    def activity_sigma_bq(self) -> float | None:
        """1 sigma of the activity."""

    @property
    def evidence(self) -> float | None:
        """Natural logarithm of the likelihood ratio of a source to none; None from an estimator without one."""

    def sight_of(self, drone: str) -> Seen:
        """Position of the source by a drone's own localisation; the hypothesis itself if the bias of that is unknown."""


@dataclass(frozen=True, slots=True)
class Claim:
    """One tracking sample of the first drone: its error, and the squared error in units of its covariance (NEES)."""

    error_m: float
    nees: float | None

    @property
    def region(self) -> float | None:
        """Return the probability of the smallest region of the posterior, a Gaussian over the plane, that contains the truth.

        For a calibrated estimator it is uniform between 0 and 1: the truth is in the 90 % region if this is at most 0.9.
        """
        return None if self.nees is None else 1.0 - math.exp(-0.5 * self.nees)


class Score:
    """Errors of one estimator against the truth.

    errors_m: horizontal, of all drones and tracking samples. relative_m: the same in each vehicle's own frame, between its
    position of the source and that of an error-free camera, namely the truth shifted by the vehicle's position error. sampled:
    one claim per run, at the first sample after ``sample_after_s`` of tracking; of a run that ends before, the last one.
    """

    def __init__(self, estimator: str, drones: Sequence[str], sample_after_s: float) -> None:
        self.estimator = estimator
        self.x0_s: float | None = None
        self.x0_error_m: float | None = None
        self.x0_rms_m: float | None = None
        self.errors_m: list[float] = []
        self.relative_m: list[float] = []
        self.nees: list[float] = []
        self.sampled: Claim | None = None
        self.lost = False
        self._drones = tuple(drones)
        self._sample_after_s = sample_after_s
        self._chosen = False
        self._bad_since_s: float | None = None

    def record_x0(self, time_s: float, belief: Belief | None, source: tuple[float, float] | None) -> None:
        """Record time and error of the initial estimate; without a source there is no error."""
        if self.x0_s is not None or belief is None:
            return
        self.x0_s = time_s
        self.x0_rms_m = rms_m(belief)
        if source is not None:
            self.x0_error_m = error_m(belief, source)

    def sample(
        self, tracked_s: float, beliefs: Sequence[Belief | None], source: tuple[float, float], position_error: Array | None,
        first: int = 0,
    ) -> None:  # fmt: skip
        """Add one tracking sample.

        Args:
            tracked_s: time of tracking until now.
            beliefs: of each drone; a missing hypothesis has no error.
            source: true position.
            position_error: (N, 3) of each vehicle's localisation, measured minus true; None if unknown.
            first: the drone whose claim is recorded.
        """
        for place, belief in enumerate(beliefs):
            if belief is None:
                continue
            dx, dy = _offset(belief, source)
            self.errors_m.append(math.hypot(dx, dy))
            nees = nees_of(belief, dx, dy)
            if nees is not None:
                self.nees.append(nees)
            if position_error is not None:
                self.relative_m.append(own_error_m(belief, self._drones[place], source, position_error[place]))
            if place == first and not self._chosen:
                self.sampled = Claim(self.errors_m[-1], nees)
                self._chosen = tracked_s >= self._sample_after_s - 1e-9

    def check_lost(self, time_s: float) -> None:
        """Note a loss of the source: the latest error has been above the limit for long."""
        if not self.errors_m or self.errors_m[-1] <= LOST_ERROR_M:
            self._bad_since_s = None
        elif self._bad_since_s is None:
            self._bad_since_s = time_s
        elif time_s - self._bad_since_s >= LOST_ERROR_S:
            self.lost = True


def rms_m(belief: Belief) -> float:
    """Return the horizontal RMS of the posterior, metres."""
    return math.sqrt(max(0.0, float(belief.covariance[0, 0] + belief.covariance[1, 1])))


def error_m(belief: Belief, source: tuple[float, float]) -> float:
    """Return the horizontal error of the estimated source position, metres."""
    return math.hypot(*_offset(belief, source))


def own_error_m(belief: Belief, drone: str, source: tuple[float, float], position_error: Array) -> float:
    """Return the horizontal error of the source by a drone's own localisation, m; position_error: (3,) measured minus true."""
    x, y = (belief.sight_of(drone).position - position_error)[:2].tolist()
    return math.hypot(x - source[0], y - source[1])


def nees_of(belief: Belief, dx: float, dy: float) -> float | None:
    """Return the squared horizontal error (dx, dy) in units of the covariance (NEES); None for a singular covariance."""
    cov = belief.covariance
    a, b, c = float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1])
    determinant = a * c - b * b
    if determinant <= 0.0:
        return None
    return (c * dx * dx - 2.0 * b * dx * dy + a * dy * dy) / determinant


def _offset(belief: Belief, source: tuple[float, float]) -> tuple[float, float]:
    return float(belief.position[0]) - source[0], float(belief.position[1]) - source[1]
