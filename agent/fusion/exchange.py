"""The queries by which agents exchange the entries that are missing from their logs."""

from __future__ import annotations

from collections import Counter

from radron.agent.fusion.log import ObservationLog
from radron.protocol.errors import ProtocolError
from radron.protocol.keys import drone_key
from radron.protocol.summary import decode_summary, encode_summary

MAX_ANSWER_ENTRIES = 500  # of one answer; the peer requests further ones
MAX_ANSWER_BYTES = 1_000_000


class LogExchange:
    """Exchanges log entries between agents: requests for entries missing in this agent's log, and answers to requests of other
    agents.
    """

    def __init__(self, swarm: str, drone: str | None, log: ObservationLog, counters: Counter[str]) -> None:
        """Set up the exchange of one log. ``drone``: the log's owner; None: a station, which publishes no summary."""
        self._swarm, self._drone = swarm, drone
        self._log = log
        self._counters = counters
        self._turn = 0  # of the summaries: none has the hashes of all blocks

    def summary(self) -> bytes:
        """Return an encoded summary of the log, with which other agents find the entries that are missing here."""
        self._turn += 1
        return encode_summary(self._log.mission_id, self._log.summary(self._turn))

    def answer(self, request: bytes) -> list[tuple[str, bytes]]:
        """Return keys and payloads of the entries that another agent lacks, some of every publisher, up to the limits of one
        answer.

        request: encoded summary of the other agent's log. An empty request asks for the summary of this log. A malformed summary,
        or a summary of another mission's log, is counted and not answered.
        """
        if not request and self._drone is not None:
            return [(drone_key(self._swarm, self._drone, "log"), self.summary())]
        try:
            mission, summary = decode_summary(request)
        except ProtocolError:
            self._counters["rejected_malformed"] += 1
            return []
        if mission != self._log.mission_id:
            self._counters["dropped_query_of_another_mission"] += 1
            return []
        replies, left = [], MAX_ANSWER_BYTES
        for identity, record in self._log.missing_from(summary, MAX_ANSWER_ENTRIES):
            left -= len(record.payload)
            if left < 0:
                break
            replies.append((drone_key(self._swarm, identity.drone, record.kind.__name__.lower()), record.payload))
        return replies
