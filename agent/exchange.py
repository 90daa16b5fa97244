"""The queries by which agents give each other what their logs lack."""

from __future__ import annotations

from collections import Counter

from agent.fusion.log import ObservationLog
from protocol.errors import ProtocolError
from protocol.keys import key_of
from protocol.summary import decode_summary, encode_summary

MOST_ENTRIES = 500  # of one answer: whoever lacks more asks again
MOST_BYTES = 1_000_000


class LogExchange:
    """Summaries of one agent's log for the others' answers, and answers to their summaries."""

    def __init__(self, swarm: str, log: ObservationLog, counters: Counter[str]) -> None:
        self._swarm = swarm
        self._log = log
        self._counters = counters

    def summary(self) -> bytes:
        """What the log holds, as a request for what it lacks."""
        return encode_summary(self._log.mission_id, self._log.summary())

    def answer(self, request: bytes) -> list[tuple[str, bytes]]:
        """Keys and payloads of what the asker lacks, the oldest first, no more than one answer may hold.

        What is no summary, or one of another mission's log, is counted and gets nothing.
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
        for record in self._log.missing_from(summary)[:MOST_ENTRIES]:
            left -= len(record.payload)
            if left < 0:
                break
            replies.append((key_of(self._swarm, record.entry), record.payload))
        return replies
