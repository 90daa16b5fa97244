"""What a search leads to: the source, the way home, or on to the next stage of it."""

from __future__ import annotations

from math import inf

from agent.config.mission import TrackConfig
from agent.mission.situation import Situation
from protocol.messages import Stage

_FOUND_AGAIN = 0.7  # of the RMS at which the source counts as lost: hysteresis


class Searching:
    """Of one drone: when it ends its search, and when the source counts as lost."""

    def __init__(self, track: TrackConfig, *, gives_up: bool, can_lose: bool) -> None:
        """``gives_up``: it returns where nothing is found; ``can_lose``: the hypothesis rests on measurements."""
        self._track, self._gives_up, self._can_lose = track, gives_up, can_lose
        self._stranded_since_ns: int | None = None

    def next(self, stage: Stage, situation: Situation, tracking_since_ns: int | None) -> Stage:
        """The stage that follows on one of a search; the same while nothing calls for another one."""
        if situation.must_return or self._is_stranded(situation):
            return Stage.RETURN
        is_over = self._is_over(situation.now_ns, tracking_since_ns)
        if stage is Stage.SURVEY:
            if situation.is_found:
                return Stage.TRACK
            ends = (situation.nothing_found and self._gives_up) or (situation.has_hypothesis and is_over)
            return Stage.RETURN if ends else stage
        if not situation.has_hypothesis:  # a late entry can remove the hypothesis
            return Stage.SURVEY
        if is_over:
            return Stage.RETURN
        if situation.searches_on:
            return Stage.SURVEY
        return Stage.REACQUIRE if self._is_lost(stage, situation, tracking_since_ns) else Stage.TRACK

    def _is_stranded(self, situation: Situation) -> bool:
        """Whether what has it return, as the others are not heard or its place is in doubt, has lasted for long enough."""
        if situation.stranded_s == inf:
            self._stranded_since_ns = None
        elif self._stranded_since_ns is None or self._stranded_since_ns > situation.now_ns:
            self._stranded_since_ns = situation.now_ns
        since_ns = self._stranded_since_ns
        return since_ns is not None and (situation.now_ns - since_ns) * 1e-9 > situation.stranded_s

    def _is_over(self, now_ns: int, tracking_since_ns: int | None) -> bool:
        """Whether the time for what has been found is over."""
        duration_s = self._track.duration_s
        return tracking_since_ns is not None and duration_s is not None and now_ns - tracking_since_ns > duration_s * 1e9

    def _is_lost(self, stage: Stage, situation: Situation, tracking_since_ns: int | None) -> bool:
        """By the posterior's RMS where there is one, otherwise by the time without a cone."""
        if not self._can_lose:
            return False
        if situation.rms_m is not None:
            share = _FOUND_AGAIN if stage is Stage.REACQUIRE else 1.0
            return situation.rms_m > share * self._track.lost_rms_m
        timeout_s = self._track.no_cone_timeout_s
        if timeout_s is None or tracking_since_ns is None:
            return False
        return situation.now_ns - max(situation.last_cone_ns, tracking_since_ns) > timeout_s * 1e9
