"""Answers to the log queries of peers, sent in separate threads.

Limits: a share of the event loop's time, a budget of bytes for each drone, and a budget for all operators together.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import zenoh

from radron.protocol.bucket import Bucket
from radron.protocol.codes import Code
from radron.protocol.mesh.link import in_thread
from radron.protocol.texts import CodedText
from radron.protocol.units import STATION

MAX_LOOP_SHARE = 0.1  # of the loop's time goes into answers at most, at any rate of queries
MAX_OPEN_QUERIES = 8  # queries answered at the same time
MAX_DRONE_BPS, MAX_DRONE_BURST = 2e6, 4e6  # bytes; a drone whose log is empty takes in 1.2 MB/s (``inbox.ANSWERED_PER_S``)
MAX_OPERATORS_BPS, MAX_OPERATORS_BURST = 0.5e6, 4e6  # of all stations; published entries reach them anyway
MAX_REFUSED_PS, MAX_REFUSED_BURST = 1.0, 5.0  # before a problem is reported: a member without an answer waits two seconds
REFUSAL_REPORTED_S = 10.0  # after the last refusal

Answer = Callable[[bytes], list[tuple[str, bytes]]]


@dataclass(frozen=True, slots=True)
class _Quota:
    """Quota of one asker: bytes of its answers, and refused queries before a problem is reported."""

    answered: Bucket
    refused: Bucket

    @classmethod
    def of(cls, asker: str, now_s: float) -> _Quota:
        """Return a full quota, of a drone or of all operators together."""
        bounds = (MAX_OPERATORS_BPS, MAX_OPERATORS_BURST) if asker == STATION else (MAX_DRONE_BPS, MAX_DRONE_BURST)
        return cls(Bucket(*bounds, now_s), Bucket(MAX_REFUSED_PS, MAX_REFUSED_BURST, now_s))


class Answers:
    """Sends the log entries that peers ask for, with limits that keep a greedy peer from slowing down this drone.

    Counters: ``log_answered``, ``log_answer_failed``, ``log_answer_refused``.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, answer: Answer, counters: Counter[str]) -> None:
        """``answer``: finds the log entries for a query's payload, as (key, payload) of each reply. ``counters``: counts of
        answers.
        """
        self._loop, self._answer, self._counters = loop, answer, counters
        self._sending = 0
        self._credit_s = Bucket(MAX_LOOP_SHARE, MAX_LOOP_SHARE, loop.time())
        self._quotas: dict[str, _Quota] = {}  # by asker

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """Peers that continue to query the log although their budget of bytes is spent, one line each."""
        now_s = self._loop.time()
        crowding = [asker for asker, quota in self._quotas.items() if quota.refused.left(now_s) < 0.0]
        named = ((asker, None if asker == STATION else asker) for asker in crowding)
        text = "{} asks for too much of the log"
        return tuple(CodedText(Code.LOG_QUERIES, text.format(about or "an operator"), about) for _, about in named)

    def reply(self, query: zenoh.Query, asker: str) -> None:
        """Answer a peer's query for log entries, or refuse it if a limit is reached. Must be called in the event loop's thread.

        ``asker``: id of the querying drone, or ``STATION`` for an operator. Failures are counted.
        """
        replies: list[tuple[str, bytes]] = []
        begun_s = self._loop.time()
        if asker not in self._quotas:
            self._quotas[asker] = _Quota.of(asker, begun_s)
        quota = self._quotas[asker]
        if quota.answered.left(begun_s) <= 0.0:
            self._counters["log_answer_refused"] += 1
            if quota.refused.left(begun_s) > -REFUSAL_REPORTED_S * MAX_REFUSED_PS:
                quota.refused.charge(1.0)
        elif self._sending >= MAX_OPEN_QUERIES or self._credit_s.left(begun_s) <= 0.0:
            self._counters["log_answer_refused"] += 1
        else:
            try:
                replies = self._answer(query.payload.to_bytes() if query.payload is not None else b"")
                self._counters["log_answered"] += 1
                quota.answered.charge(sum(len(payload) for _, payload in replies))
            except Exception:
                self._counters["log_answer_failed"] += 1
            self._credit_s.charge(self._loop.time() - begun_s)

        def send() -> None:
            with query:  # leaving the block ends the query for the peer
                for key, payload in replies:
                    query.reply(key, payload)

        self._sending += 1
        in_thread(send).add_done_callback(self._sent)

    def _sent(self, sending: asyncio.Future[None]) -> None:
        self._sending -= 1
        if not sending.cancelled() and sending.exception() is not None:
            self._counters["log_answer_failed"] += 1
