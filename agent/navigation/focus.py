"""Which of several sources the swarm circles, and where it looks whether one moves.

It follows from the hypothesis alone, so drones with equal logs choose alike.
"""

from __future__ import annotations

from msgspec.structs import replace

from agent.config.mission import MissionConfig
from agent.fusion.estimator import Hypothesis


def focus(hypothesis: Hypothesis | None, mission: MissionConfig) -> Hypothesis | None:
    """The source to circle; where there is but one, the hypothesis itself.

    Each has its turns of ``track.each_s`` with every drone: a source that has had fewer than another comes first, and of those
    the one whose turn has begun. The policy begins when each has had one. Before all of that comes a look at one that may move.
    """
    if hypothesis is not None and hypothesis.look is not None:
        return replace(hypothesis.look, evidence=hypothesis.evidence, others=())
    if hypothesis is None or not hypothesis.others:
        return hypothesis
    track, sources, turns = mission.track, (hypothesis, *hypothesis.others), _turns(hypothesis, mission)
    least = min(turns)
    if least == 0 or track.policy == "each":
        waiting = [one for one, had in zip(sources, turns, strict=True) if had == least]
        chosen = max(waiting, key=lambda one: one.watched_s or 0.0)
    else:
        chosen = next((one for one in sources if one.nuclide == track.policy), hypothesis)
    return replace(chosen, evidence=hypothesis.evidence, others=())


def looks(hypothesis: Hypothesis | None) -> bool:
    """Whether a source may move, and is looked at until that is clear."""
    return hypothesis is not None and hypothesis.look is not None


def have_had_turns(hypothesis: Hypothesis, mission: MissionConfig) -> bool:
    """Whether each source has had a turn."""
    return min(_turns(hypothesis, mission)) > 0


def is_in_second_half(source: Hypothesis, mission: MissionConfig) -> bool:
    """Whether the present turn of a source that is circled is half over; never of one that has no turns."""
    return source.watched_s is not None and source.watched_s / mission.turn_s % 1.0 >= 0.5


def _turns(hypothesis: Hypothesis, mission: MissionConfig) -> list[int]:
    """That the hypothesis and the other sources have had."""
    return [int((one.watched_s or 0.0) / mission.turn_s) for one in (hypothesis, *hypothesis.others)]
