"""Messages from Zenoh's threads to the event loop: entries and commands lossless and in order, of other kinds only the newest.

A burst costs the loop one call from another thread. It is delivered in slices, commands first and log entries last, so that a
backlog of recovered entries neither delays the control step nor makes poses stale.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections import Counter, deque
from collections.abc import Callable

from protocol.codec import MAX_ENTRY_BYTES, MAX_PAYLOAD_BYTES
from protocol.entries import Entry
from protocol.errors import ProtocolError
from protocol.keys import Key, parse_key
from protocol.messages import DRONE_KINDS

ENTRY_KINDS = tuple(kind for kind, message in DRONE_KINDS.items() if issubclass(message, Entry))
NEWS_KINDS = tuple(kind for kind in DRONE_KINDS if kind not in ENTRY_KINDS)
SLICE_MESSAGES = 100
SLICE_S = 0.005
MOST_ENTRIES = 50_000  # waiting for delivery; more are dropped, and recovered by the log query
MOST_COMMANDS = 1_000
MOST_NEWS_KEYS = 1_000  # a swarm of 64 drones has 320

Receive = Callable[[Key, bytes], None]


class Inbox:
    """Takes messages in any thread, delivers them in the loop's, with their keys as read here once.

    Counts ``received`` (delivered), ``superseded`` (replaced by a newer one before delivery); and of what it drops ``overflow``
    (beyond the bounds above), ``oversized``, ``other_swarm``, ``unknown_key``.
    """

    def __init__(
        self, loop: asyncio.AbstractEventLoop, swarm: str, receive: Receive, drained: Callable[[], None], counters: Counter[str]
    ) -> None:
        self._loop = loop
        self._swarm = swarm
        self._receive = receive
        self._drained = drained
        self._counters = counters
        self._intake: deque[tuple[str, bytes | None]] = deque()  # append and popleft are atomic
        self._called = False  # a call that empties the intake is scheduled
        self._delivering = False  # the next slice is scheduled
        self._closed = False
        self._overflow_lock = threading.Lock()
        self._overflow = 0
        self._commands: deque[tuple[Key, bytes]] = deque()
        self._news: dict[Key, bytes] = {}
        self._entries: deque[tuple[Key, bytes]] = deque()

    def put(self, key: str, payload: bytes | None) -> None:
        """Take a message, in any thread; None stands for a payload that was too large."""
        if len(self._intake) >= MOST_ENTRIES:  # the loop stands still
            with self._overflow_lock:
                self._overflow += 1
            return
        self._intake.append((key, payload))
        if not self._called:
            self._called = True
            with contextlib.suppress(RuntimeError):  # the loop is closed
                self._loop.call_soon_threadsafe(self._take_in)

    def close(self) -> None:
        """Stop delivering."""
        self._closed = True

    def _take_in(self) -> None:
        self._called = False  # before the intake is emptied: later messages schedule another call
        for _ in range(len(self._intake)):
            self._sort(*self._intake.popleft())
        with self._overflow_lock:
            lost, self._overflow = self._overflow, 0
        self._count_overflow(lost)
        if not self._delivering:
            self._deliver()

    def _sort(self, text: str, payload: bytes | None) -> None:
        try:
            key = parse_key(text)
        except ProtocolError:
            self._counters["unknown_key"] += 1
            return
        if key.swarm != self._swarm:
            self._counters["other_swarm"] += 1
        elif payload is None or len(payload) > (MAX_ENTRY_BYTES if key.kind in ENTRY_KINDS else MAX_PAYLOAD_BYTES):
            self._counters["oversized"] += 1
        elif key.kind in ENTRY_KINDS:
            self._keep(self._entries, MOST_ENTRIES, key, payload)
        elif key.kind == "command":
            self._keep(self._commands, MOST_COMMANDS, key, payload)
        elif key in self._news:
            self._news[key] = payload
            self._counters["superseded"] += 1
        elif len(self._news) < MOST_NEWS_KEYS:
            self._news[key] = payload
        else:
            self._count_overflow(1)

    def _keep(self, queue: deque[tuple[Key, bytes]], most: int, key: Key, payload: bytes) -> None:
        if len(queue) < most:
            queue.append((key, payload))
        else:
            self._count_overflow(1)

    def _count_overflow(self, lost: int) -> None:
        if lost:
            self._counters["overflow"] += lost

    def _deliver(self) -> None:
        """One slice; the next follows when the loop has processed everything else that is due."""
        self._delivering = False
        until_s = self._loop.time() + SLICE_S
        try:
            for _ in range(SLICE_MESSAGES):
                message = self._next()
                if message is None or self._closed:
                    break
                self._counters["received"] += 1
                self._receive(*message)
                if self._loop.time() > until_s:
                    break
        finally:  # an exception of the receiver affects one message only
            if not self._closed and (self._commands or self._news or self._entries):
                self._delivering = True
                self._loop.call_soon(self._deliver)
        if not self._closed:
            self._drained()

    def _next(self) -> tuple[Key, bytes] | None:
        if self._commands:
            return self._commands.popleft()
        if self._news:
            key = next(iter(self._news))
            return key, self._news.pop(key)
        return self._entries.popleft() if self._entries else None
