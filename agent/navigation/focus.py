"""Choice among several sources: the source to circle, and verification passes over a source that may move.

The choice follows from the hypothesis alone, so drones with equal logs choose alike.
"""

from __future__ import annotations

from msgspec.structs import replace

from radron.agent.config.mission import MissionConfig
from radron.agent.fusion.estimator import Hypothesis


def focus(hypothesis: Hypothesis | None, mission: MissionConfig) -> Hypothesis | None:
    """Return the source to circle; a single source is the hypothesis itself.

    Each source has turns of ``track.each_s`` with every drone. The source with the fewest turns comes first; among equals, the
    source whose turn has begun. The policy begins when each source has had one turn. A verification pass over a source that may
    move precedes all of this.
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
    """Whether a source may move, and verification passes go on until that is clear."""
    return hypothesis is not None and hypothesis.look is not None


def have_had_turns(hypothesis: Hypothesis, mission: MissionConfig) -> bool:
    """Whether each source has had a turn."""
    return min(_turns(hypothesis, mission)) > 0


def is_in_second_half(source: Hypothesis, mission: MissionConfig) -> bool:
    """Whether the present turn of a circled source is half over; never without turns."""
    return source.watched_s is not None and source.watched_s / mission.turn_s % 1.0 >= 0.5


def _turns(hypothesis: Hypothesis, mission: MissionConfig) -> list[int]:
    """Return the number of turns of the hypothesis and of each other source."""
    return [int((one.watched_s or 0.0) / mission.turn_s) for one in (hypothesis, *hypothesis.others)]
