"""Estimates of the drones' local frames, computed only once for all agents with equal logs, to save time.

An estimate at a keyframe (time of re-estimation) is a pure function of the checkpoint before it and of the observations received
in between (``radron.agent.frames``). A checkpoint is therefore identified by its lineage: all keyframes before it, and the
observations received for each.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

from radron.agent.config.mission import MissionConfig
from radron.agent.frames.checkpoint import Checkpoint
from radron.agent.frames.estimate import Estimate
from radron.agent.frames.intake import Intake
from radron.sim.lockstep.sharing import MAX_LINEAGES, Results

MAX_FRAME_CHECKPOINTS = 256  # remembered, of 20 kB each; beyond that, keyframes are computed again


@dataclass(frozen=True, slots=True)
class DescendedCheckpoint(Checkpoint):
    """A state of the frame estimate (checkpoint) with its lineage: all observations from which it was computed.

    Agents with equal observations have one and the same lineage object, by which results are shared.
    """

    lineage: object = None


class SharedFrames:
    """Gives each agent of a flight its estimate of the local frames, and shares the computations between them."""

    def __init__(self) -> None:
        self._lineages, self._checkpoints = Results(MAX_LINEAGES), Results(MAX_FRAME_CHECKPOINTS)

    def __call__(self, mission: MissionConfig, intake: Intake) -> SharedEstimate:
        """Return the ``Estimate`` of one agent."""
        return SharedEstimate(Estimate(mission, intake), intake, self._lineages, self._checkpoints)


class SharedEstimate:
    """One agent's estimate of the local frames; computes nothing that another agent has computed."""

    def __init__(self, estimate: Estimate, intake: Intake, lineages: Results, checkpoints: Results) -> None:
        self._estimate, self._intake = estimate, intake
        self._lineages, self._checkpoints = lineages, checkpoints

    def step(self, before: Checkpoint, index: int) -> Checkpoint:
        """Return the state of the frame estimate (checkpoint) at the next keyframe, as ``Estimate`` computes it.

        A keyframe is a time at which the drones' local frames are estimated anew.
        """
        former = before.lineage if isinstance(before, DescendedCheckpoint) else None
        lineage = self._lineages.get((former, index, self._intake.content(before.index, index)), object)
        return self._checkpoints.get(lineage, lambda: self._computed(before, index, lineage))

    def _computed(self, before: Checkpoint, index: int, lineage: object) -> DescendedCheckpoint:
        after = self._estimate.step(before, index)
        return DescendedCheckpoint(**{one.name: getattr(after, one.name) for one in fields(after)}, lineage=lineage)
