"""Which of several sources the swarm circles: it follows from the hypothesis alone, so drones with equal logs choose alike."""

from __future__ import annotations

from msgspec.structs import replace

from agent.config.mission import MissionConfig
from agent.fusion.estimator import Hypothesis


def focus(hypothesis: Hypothesis | None, mission: MissionConfig) -> Hypothesis | None:
    """The source to circle; where there is but one, the hypothesis itself.

    Each has its turns of ``track.each_s`` with every drone: a source that has had fewer than another comes first, and of those
    the one whose turn has begun. The policy begins when each has had one.
    """
    if hypothesis is None or not hypothesis.others:
        return hypothesis
    track, sources = mission.track, (hypothesis, *hypothesis.others)
    turn_s = track.each_s * len(mission.drones)
    turns = [int((one.watched_s or 0.0) / turn_s) for one in sources]
    least = min(turns)
    if least == 0 or track.policy == "each":
        waiting = [one for one, had in zip(sources, turns, strict=True) if had == least]
        chosen = max(waiting, key=lambda one: one.watched_s or 0.0)
    else:
        chosen = next((one for one in sources if one.nuclide == track.policy), hypothesis)
    return replace(chosen, evidence=hypothesis.evidence, others=())
