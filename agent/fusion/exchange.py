"""The queries by which agents exchange the entries that are missing from their logs."""

from __future__ import annotations

from collections import Counter

from agent.fusion.log import ObservationLog
from protocol.errors import ProtocolError
from protocol.keys import drone_key
from protocol.summary import decode_summary, encode_summary

MOST_ENTRIES = 500  # of one answer; for more the peer asks again
MOST_BYTES = 1_000_000


class LogExchange:
    """Requests for entries missing from one agent's log, and answers to the requests of its peers."""

    def __init__(self, swarm: str, log: ObservationLog, counters: Counter[str]) -> None:
        self._swarm = swarm
        self._log = log
        self._counters = counters

    def summary(self) -> bytes:
        """A summary of the log, as a request for the entries that are missing from it."""
        return encode_summary(self._log.mission_id, self._log.summary())

    def answer(self, request: bytes) -> list[tuple[str, bytes]]:
        """Keys and payloads of the entries that the peer lacks, some of every publisher, up to the limits of one answer.

        A request that is no summary, or that of another mission's log, is counted and not answered.
        """
        try:
            mission, summary = decode_summary(request)
        except ProtocolError:
            self._counters["rejected_malformed"] += 1
            return []
        if mission != self._log.mission_id:
            self._counters["dropped_query_of_another_mission"] += 1
            return []
        replies, left = [], MOST_BYTES
        for identity, record in self._log.missing_from(summary, MOST_ENTRIES):
            left -= len(record.payload)
            if left < 0:
                break
            replies.append((drone_key(self._swarm, identity.drone, record.kind.__name__.lower()), record.payload))
        return replies
