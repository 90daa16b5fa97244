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
    """Position of a source as one drone would see it with the error of its own localisation."""

    @property
    def position(self) -> Array:
        """(3,) mission frame, metres."""


class Belief(Protocol):
    """The parts of a source estimate that are scored; mission frame, metres."""

    @property
    def position(self) -> Array:
        """(3,) position of the source."""

    @property
    def covariance(self) -> Array:
        """(3, 3) covariance of the position."""

    @property
    def activity_bq(self) -> float | None:
        """Activity of the source in becquerels; None if the estimator does not estimate it."""

    @property
    def activity_sigma_bq(self) -> float | None:
        """1-sigma error of the activity in becquerels."""

    @property
    def evidence(self) -> float | None:
        """Natural logarithm of the likelihood ratio of a source to no source; None if the estimator does not give it."""

    def sight_of(self, drone: str) -> Seen:
        """Return the source's position as a drone would see it with the error of its own localisation.

        If this error is unknown, the position is that of the estimate itself.
        """


@dataclass(frozen=True, slots=True)
class Claim:
    """Error of the first drone's source estimate at one time, and its squared error in units of its covariance (NEES)."""

    error_m: float
    nees: float | None

    @property
    def region(self) -> float | None:
        """Probability of the smallest region of the posterior, taken as a Gaussian over the plane, that contains the true source.

        For a calibrated estimator it is uniform between 0 and 1: the truth is in the 90 % region if this is at most 0.9.
        """
        return None if self.nees is None else 1.0 - math.exp(-0.5 * self.nees)


class Score:
    """Collects the errors of one estimator against the truth in a flight.

    errors_m: horizontal, of all drones and tracking samples. relative_m: errors in each vehicle's own frame, between its position
    of the source and the position by an error-free camera (the truth shifted by the vehicle's position error). sampled: one claim
    per flight, at the first sample after ``sample_after_s`` of tracking; of a flight that ends before, the last one.
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
        """Record time and error of the first source estimate (x0); without a true source there is no error."""
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
        """Add the errors of all drones' estimates at one time of the tracking.

        Args:
            tracked_s: time of tracking until now.
            beliefs: estimate of each drone; a missing estimate has no error.
            source: true position.
            position_error: (N, 3) of each vehicle's localisation, measured minus true; None if unknown.
            first: index of the drone whose claim is recorded.
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
        """Record that the source is lost if the newest error has been above a limit for a long time."""
        if not self.errors_m or self.errors_m[-1] <= LOST_ERROR_M:
            self._bad_since_s = None
        elif self._bad_since_s is None:
            self._bad_since_s = time_s
        elif time_s - self._bad_since_s >= LOST_ERROR_S:
            self.lost = True


def rms_m(belief: Belief) -> float:
    """Return the horizontal root mean square uncertainty of a source estimate, metres."""
    return math.sqrt(max(0.0, float(belief.covariance[0, 0] + belief.covariance[1, 1])))


def error_m(belief: Belief, source: tuple[float, float]) -> float:
    """Return the horizontal error of an estimated source position, metres."""
    return math.hypot(*_offset(belief, source))


def own_error_m(belief: Belief, drone: str, source: tuple[float, float], position_error: Array) -> float:
    """Return the horizontal error (m) of the source position in the view of one drone, whose localisation error is taken out.

    position_error: (3,) localisation error of the drone, measured minus true.
    """
    x, y = (belief.sight_of(drone).position - position_error)[:2].tolist()
    return math.hypot(x - source[0], y - source[1])


def nees_of(belief: Belief, dx: float, dy: float) -> float | None:
    """Return the squared horizontal error (dx, dy) in units of the estimate's covariance (NEES).

    Return None if the covariance is singular.
    """
    cov = belief.covariance
    a, b, c = float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1])
    determinant = a * c - b * b
    if determinant <= 0.0:
        return None
    return (c * dx * dx - 2.0 * b * dx * dy + a * dy * dy) / determinant


def _offset(belief: Belief, source: tuple[float, float]) -> tuple[float, float]:
    return float(belief.position[0]) - source[0], float(belief.position[1]) - source[1]
