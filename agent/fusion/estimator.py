"""The interface behind which the estimators stand, and what they yield."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from agent.fusion.observation import Observation
from protocol.messages import AnyEntry

S = TypeVar("S")


@dataclass(frozen=True, slots=True)
class GridStep:
    """One step of the fixed time grid: [start_ns, end_ns) UTC; start_ns = index x the grid's width."""

    index: int
    start_ns: int
    end_ns: int


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """Where the source is thought to be at ``stamp_ns``, mission frame. The arrays are read-only.

    position: (3,) metres. covariance: (3, 3) m2. velocity: (3,) m/s. cones: how many it follows from.
    x0_stamp_ns: when the first hypothesis was declared. activity_bq: None if the estimator does not know.
    """

    stamp_ns: int
    position: NDArray[np.float64]
    covariance: NDArray[np.float64]
    velocity: NDArray[np.float64]
    cones: int
    x0_stamp_ns: int
    activity_bq: float | None = None
    activity_sigma_bq: float | None = None

    def __post_init__(self) -> None:
        for array in (self.position, self.covariance, self.velocity):
            array.setflags(write=False)


class Estimator(Protocol, Generic[S]):
    """Observations -> hypothesis, as pure functions on an immutable state ``S``.

    Nothing but the arguments may enter a result: no clock, no random state, no memory of earlier calls. Then the hypothesis is a
    function of the log, and a late entry is merged by stepping again from an earlier state.
    """

    name: str
    reads: tuple[type[AnyEntry], ...]  # the kinds of entries that it wants to see as observations

    def initial(self, start_ns: int | None) -> S:
        """State before the first observation. ``start_ns``: the mission's start, None if it is not known."""

    def step(self, state: S, step: GridStep, observations: Sequence[Observation]) -> S:
        """State after a grid step that has observations (in the order of their entries' identities).

        Called in ascending order, for such steps only: what passes in empty steps between (noise, motion) is for the
        estimator to account for, and must not depend on where now is.
        """

    def hypothesis(self, state: S, step: GridStep) -> Hypothesis | None:
        """What the state says as seen from ``step``, which is the step of its last observation or a later one."""
