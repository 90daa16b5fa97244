"""The estimator ``given``: a hypothesis that moves by a schedule in the mission file (the paper's swarm stabilisation)."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from radron.agent.config.estimators import GivenHypothesisConfig
from radron.agent.errors import ConfigError
from radron.agent.fusion.estimator import GridStep, Hypothesis, Outlook
from radron.agent.fusion.observation import Observation
from radron.agent.terrain.ground import LEVEL, Ground
from radron.protocol.entries import AnyEntry

_NS = 1_000_000_000


class GivenEstimator:
    """An estimator that measures nothing: its source estimate moves by a schedule in the mission file, for tests of the flight.

    Each place of the schedule is held until the next time of the schedule. Jumps take effect at the first grid step that begins
    at or after that time. There is no estimate before the schedule's first time, nor before the mission's start.

    Raises:
        ConfigError: the schedule's times do not ascend.
    """

    name = "given"
    reads: tuple[type[AnyEntry], ...] = ()
    grid_s: float | None = None
    hold_s = 0.0

    def __init__(self, config: GivenHypothesisConfig, ground: Ground = LEVEL) -> None:
        self._ground = ground
        self._offsets_ns = [round(time_s * _NS) for time_s, _, _ in config.schedule]
        self._places = [(x, y) for _, x, y in config.schedule]
        if any(later <= earlier for earlier, later in pairwise(self._offsets_ns)):
            raise ConfigError("fusion.given.schedule: times must ascend; sort the rows [t_s, x, y] by t_s")

    def initial(self, start_ns: int | None) -> int | None:
        """Return the estimator's state, which is the mission's start (UTC, ns)."""
        return start_ns

    def step(self, state: int | None, step: GridStep, observations: Sequence[Observation]) -> int | None:
        """Return the estimator's state unchanged; observations are not used."""
        return state

    def work(self, state: int | None, observations: int) -> int:
        """Return the cost of a step: about one unit for the step, and one for each observation."""
        return 1 + observations

    def hypothesis(self, state: int | None, step: GridStep) -> Hypothesis | None:
        """Return the schedule's place at the beginning of the step as source estimate, without error."""
        if state is None:
            return None
        row = bisect_right(self._offsets_ns, step.start_ns - state) - 1
        if row < 0:
            return None
        x, y = self._places[row]
        return Hypothesis(
            stamp_ns=step.start_ns,
            position=np.array([x, y, self._ground.height_m(x, y)]),
            covariance=np.zeros((3, 3)),
            velocity=np.zeros(3),
            cones=0,
            x0_stamp_ns=state + self._offsets_ns[0],
        )

    def outlook(self, state: int | None, step: GridStep) -> Outlook | None:
        """Return None: this estimator has no posterior of a search."""
        return None
