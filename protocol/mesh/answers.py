"""Answers to the log queries of peers: a bounded share of the event loop's time, and sent in threads of their own."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable

import zenoh

from protocol.bucket import Bucket
from protocol.mesh.link import in_thread

SHARE = 0.1  # of the loop's time goes into answers at most, however often somebody asks
MOST = 8  # queries answered at the same time

Answer = Callable[[bytes], list[tuple[str, bytes]]]


class Answers:
    """Counts ``log_answered``, ``log_answer_failed``, ``log_answer_refused``."""

    def __init__(self, loop: asyncio.AbstractEventLoop, answer: Answer, counters: Counter[str]) -> None:
        """``answer``: from the payload of a query to (key, payload) of each reply."""
        self._loop, self._answer, self._counters = loop, answer, counters
        self._sending = 0
        self._credit_s = Bucket(SHARE, SHARE, loop.time())

    def reply(self, query: zenoh.Query) -> None:
        """Answer a query, in the loop's thread; failures are counted."""
        replies: list[tuple[str, bytes]] = []
        begun_s = self._loop.time()
        if self._sending >= MOST or self._credit_s.left(begun_s) <= 0.0:
            self._counters["log_answer_refused"] += 1
        else:
            try:
                replies = self._answer(query.payload.to_bytes() if query.payload is not None else b"")
                self._counters["log_answered"] += 1
            except Exception:
                self._counters["log_answer_failed"] += 1
            self._credit_s.charge(self._loop.time() - begun_s)

        def send() -> None:
            with query:  # leaving the block ends it for the peer
                for key, payload in replies:
                    query.reply(key, payload)

        self._sending += 1
        in_thread(send).add_done_callback(self._sent)

    def _sent(self, sending: asyncio.Future[None]) -> None:
        self._sending -= 1
        if not sending.cancelled() and sending.exception() is not None:
            self._counters["log_answer_failed"] += 1
