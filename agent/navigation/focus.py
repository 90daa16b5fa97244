"""Choice of the source that the swarm circles, among several ones, or of a place for a verification pass.

The choice follows from the source estimate alone, so drones with equal logs choose alike.
"""

from __future__ import annotations

from msgspec.structs import replace

from radron.agent.config.mission import MissionConfig
from radron.agent.fusion.estimator import Hypothesis


def focus(hypothesis: Hypothesis | None, mission: MissionConfig) -> Hypothesis | None:
    """Return the source to circle, without the others; None without a source estimate.

    A verification pass (a flight to check whether a source moves) comes before everything else. A turn is the time
    ``track.each_s`` for which the swarm circles one source. The source with the fewest turns comes first; among equals, that
    whose turn has begun. When each source has had a turn, the policy of the mission applies (``track.policy``).
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
    """Whether a verification pass is under way: a source may move, and that has to be checked."""
    return hypothesis is not None and hypothesis.look is not None


def have_had_turns(hypothesis: Hypothesis, mission: MissionConfig) -> bool:
    """Whether each source has been circled for a whole turn."""
    return min(_turns(hypothesis, mission)) > 0


def is_in_second_half(source: Hypothesis, mission: MissionConfig) -> bool:
    """Whether the present turn around a source is half over; False if the source has no turns."""
    return source.watched_s is not None and source.watched_s / mission.turn_s % 1.0 >= 0.5


def _turns(hypothesis: Hypothesis, mission: MissionConfig) -> list[int]:
    """Return the number of completed turns of each source: of the hypothesis first, then of the others."""
    return [int((one.watched_s or 0.0) / mission.turn_s) for one in (hypothesis, *hypothesis.others)]
