"""The interface behind which the estimators stand, and what they yield."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Generic, Protocol, TypeVar

import numpy as np
from msgspec import Struct, field
from numpy.typing import NDArray

from agent.fusion.observation import Observation
from protocol.messages import AnyEntry

S = TypeVar("S")


class GridStep(Struct, frozen=True):
    """One step of the fixed time grid: [start_ns, end_ns) UTC; start_ns = index x the grid's width."""

    index: int
    start_ns: int
    end_ns: int

    @property
    def middle_ns(self) -> int:
        """Half-way."""
        return (self.start_ns + self.end_ns) // 2


def _horizontal_rms_m(covariance: NDArray[np.float64]) -> float:
    return math.sqrt(max(0.0, float(covariance[0, 0] + covariance[1, 1])))


class Sight(Struct, frozen=True, eq=False):
    """Where a drone's own localisation puts the source: what it has to fly to. Mission frame, as if the drone's poses were true.

    The drone's bias (measured minus true) shifts what it sees of itself and of the source alike; so this is known better than
    where the source is in truth. position: (3,) metres. covariance: (3, 3) m2.
    """

    position: NDArray[np.float64]
    covariance: NDArray[np.float64]

    @property
    def rms_m(self) -> float:
        """Horizontal RMS, metres."""
        return _horizontal_rms_m(self.covariance)


class Hypothesis(Struct, frozen=True, eq=False):
    """Where the source is thought to be at ``stamp_ns``, mission frame. The arrays are read-only.

    position: (3,) metres. covariance: (3, 3) m2. velocity: (3,) m/s. cones: how many it follows from.
    x0_stamp_ns: when the first hypothesis was declared. activity_bq: None if the estimator does not know.
    evidence: natural logarithm of how much likelier the observations are with a source than by background alone; None if the
    estimator does not know: then ``covariance`` is the filter's own, and need not be calibrated.
    sights: by drone, where its own localisation puts the source; empty if the estimator knows no biases.
    """

    stamp_ns: int
    position: NDArray[np.float64]
    covariance: NDArray[np.float64]
    velocity: NDArray[np.float64]
    cones: int
    x0_stamp_ns: int
    activity_bq: float | None = None
    activity_sigma_bq: float | None = None
    evidence: float | None = None
    sights: Mapping[str, Sight] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        for array in (self.position, self.covariance, self.velocity):
            array.setflags(write=False)

    @property
    def rms_m(self) -> float:
        """Horizontal RMS of the posterior, metres."""
        return _horizontal_rms_m(self.covariance)

    def sight_of(self, drone: str) -> Sight:
        """Where the source is for a drone's own localisation; the hypothesis itself where nothing is known of its bias."""
        return self.sights.get(drone) or Sight(self.position, self.covariance)


@dataclass(frozen=True, slots=True, eq=False)
class Outlook:
    """What is known while no hypothesis is declared: where a source may be, if there is one. Mission frame.

    places: (C, 2) metres. weight: (C,) probabilities of a source being there, adding up to 1 - ``none``. activity_bq: (C,) mean
    of the activity that a source there would have. none: probability that there is no source.
    excluded_bq: a source of this activity or more would have shown, in the mean over the places where it may have been; None:
    nothing is excluded yet.
    """

    places: NDArray[np.float64]
    weight: NDArray[np.float64]
    activity_bq: NDArray[np.float64]
    none: float
    excluded_bq: float | None


class Estimator(Protocol, Generic[S]):
    """Observations -> hypothesis, as pure functions on an immutable state ``S``.

    Nothing but the arguments may enter a result: no clock, no random state, no memory of earlier calls. Then the hypothesis is a
    function of the log, and a late entry is merged by stepping again from an earlier state.
    """

    name: str
    reads: tuple[type[AnyEntry], ...]  # the kinds of entries that it wants to see as observations
    grid_s: float | None  # width of the time grid that it steps on; None: the mission's
    hold_s: float  # for so long entries are left to gather before they are folded; else most are folded twice

    def initial(self, start_ns: int | None) -> S:
        """State before the first observation. ``start_ns``: the mission's start, None if it is not known."""

    def step(self, state: S, step: GridStep, observations: Sequence[Observation]) -> S:
        """State after a grid step that has observations (in the order of their entries' identities).

        Called in ascending order, for such steps only: what passes in empty steps between (noise, motion) is for the
        estimator to account for, and must not depend on where now is.
        """

    def work(self, state: S, observations: int) -> int:
        """What a step from this state with so many observations costs, in units of about 25 microseconds."""

    def hypothesis(self, state: S, step: GridStep) -> Hypothesis | None:
        """What the state says as seen from ``step``, in which now lies: that of its last observation or a later time, later by
        the hold than the grid's."""

    def outlook(self, state: S, step: GridStep) -> Outlook | None:
        """What the state says while it has no hypothesis; None where it has one, or the estimator knows of no such thing."""
