"""The frames of equal logs, estimated once for all agents of a flight: as ``sharing`` has it for the folds.

A keyframe's estimate is a pure function of the checkpoint before and of what an agent has received of the time in between
(``agent.frames``). So a checkpoint is known by its lineage: all keyframes that led to it, and what was received for each.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

from agent.config.mission import MissionConfig
from agent.frames.checkpoint import Checkpoint
from agent.frames.estimate import Estimate
from agent.frames.intake import Intake
from sim.lockstep.sharing import MOST_LINEAGES, Results

MOST_CHECKPOINTS = 256  # that are remembered, of 20 kB each; without them, the keyframe is computed again


@dataclass(frozen=True, slots=True)
class DescendedCheckpoint(Checkpoint):
    """A checkpoint, and its lineage: the same object for all to which the same has led."""

    lineage: object = None


class SharedFrames:
    """Where the agents of one flight get their estimates of the frames from."""

    def __init__(self) -> None:
        self._lineages, self._checkpoints = Results(MOST_LINEAGES), Results(MOST_CHECKPOINTS)

    def __call__(self, mission: MissionConfig, intake: Intake) -> SharedEstimate:
        """As ``Estimate``: of one agent."""
        return SharedEstimate(Estimate(mission, intake), intake, self._lineages, self._checkpoints)


class SharedEstimate:
    """The estimate of one agent, which computes no keyframe that another one has computed."""

    def __init__(self, estimate: Estimate, intake: Intake, lineages: Results, checkpoints: Results) -> None:
        self._estimate, self._intake = estimate, intake
        self._lineages, self._checkpoints = lineages, checkpoints

    def step(self, before: Checkpoint, index: int) -> Checkpoint:
        """As ``Estimate``."""
        former = before.lineage if isinstance(before, DescendedCheckpoint) else None
        lineage = self._lineages.get((former, index, self._intake.content(before.index, index)), object)
        return self._checkpoints.get(lineage, lambda: self._computed(before, index, lineage))

    def _computed(self, before: Checkpoint, index: int, lineage: object) -> DescendedCheckpoint:
        after = self._estimate.step(before, index)
        return DescendedCheckpoint(**{one.name: getattr(after, one.name) for one in fields(after)}, lineage=lineage)
