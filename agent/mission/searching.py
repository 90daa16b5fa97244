"""The events of a flight that goes by the mission: a source found or lost, the search over, home reached."""

from __future__ import annotations

from msgspec import Struct

from radron.agent.config.mission import TrackConfig
from radron.agent.mission.flight import Flight
from radron.agent.mission.situation import Situation
from radron.agent.mission.transitions import Event
from radron.protocol.messages import Stage
from radron.protocol.stages import SEARCHING

_FOUND_AGAIN = 0.7  # of the RMS at which the source counts as lost: hysteresis


class Searching(Struct, frozen=True):
    """The rules of one mission. ``gives_up``: the drone returns if nothing is found; ``can_lose``: the hypothesis rests on
    measurements, and counts as lost when they stay away.
    """

    track: TrackConfig
    gives_up: bool
    can_lose: bool

    def event(self, flight: Flight, situation: Situation, *, has_risen: bool) -> Event | None:
        """Return the event that calls for another stage, or None. ``has_risen``: the takeoff is over."""
        if flight.stage is Stage.RETURN:
            return Event.ARRIVED if situation.at_home else Event.STUCK if situation.no_nearer else None
        if flight.stage in SEARCHING:
            return self._in_search(flight, situation)
        if flight.stage is Stage.HOLD:
            return Event.ENDS if situation.must_return else None
        if not has_risen:
            return None
        return Event.ENDS if flight.resume is Stage.RETURN else Event.FOUND if situation.is_found else Event.SEARCHES

    def _in_search(self, flight: Flight, situation: Situation) -> Event | None:
        if situation.must_return or _is_stranded(flight, situation):
            return Event.ENDS
        is_over = self._is_over(situation.now_ns, flight.tracking_since_ns)
        if flight.stage is Stage.SURVEY:
            if situation.is_found:
                return Event.FOUND
            ends = (situation.nothing_found and self.gives_up) or (situation.has_hypothesis and is_over)
            return Event.ENDS if ends else None
        if not situation.has_hypothesis:  # a late entry can remove the hypothesis
            return Event.SEARCHES
        if is_over:
            return Event.ENDS
        if situation.searches_on:
            return Event.SEARCHES
        return Event.LOST if self._is_lost(flight, situation) else Event.FOUND

    def _is_over(self, now_ns: int, tracking_since_ns: int | None) -> bool:
        """Whether the time for the sources found is over."""
        duration_s = self.track.duration_s
        return tracking_since_ns is not None and duration_s is not None and now_ns - tracking_since_ns > duration_s * 1e9

    def _is_lost(self, flight: Flight, situation: Situation) -> bool:
        """By the posterior's RMS where there is one, otherwise by the time without a cone."""
        if not self.can_lose:
            return False
        if situation.rms_m is not None:
            share = _FOUND_AGAIN if flight.stage is Stage.REACQUIRE else 1.0
            return situation.rms_m > share * self.track.lost_rms_m
        timeout_s, tracking_since_ns = self.track.no_cone_timeout_s, flight.tracking_since_ns
        if timeout_s is None or tracking_since_ns is None:
            return False
        return situation.now_ns - max(situation.last_cone_ns, tracking_since_ns) > timeout_s * 1e9


def _is_stranded(flight: Flight, situation: Situation) -> bool:
    """Whether the reason for a return (links lost, position uncertain) has lasted for the return delay."""
    since_ns = flight.stranded_since_ns
    return since_ns is not None and (situation.now_ns - since_ns) * 1e-9 > situation.stranded_s
