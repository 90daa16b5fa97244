"""Publication of log entries in a separate thread.

While an advanced publisher's cache answers a peer, a put to it waits; over a congested link this lasts until Zenoh gives the
link up after 5 s. The event loop must not wait so long: the watchdog kills an agent without a step for a second.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable

import zenoh
from zenoh import ext

QUEUE_FLUSH_S = 0.2
MAX_WAITING_ENTRIES = 10_000  # entries, some megabytes; further entries are not published, and reach peers by the log query


class Outgoing:
    """Publishes log entries in a separate thread, so that a congested link does not block the event loop.

    The entries that one thread adds are published in order.
    """

    def __init__(self, failed: Callable[[], None]) -> None:
        """``failed``: called for each entry that is not published, in the caller's thread or the publishing thread."""
        self._failed = failed
        self._waiting: queue.SimpleQueue[tuple[ext.AdvancedPublisher, bytes] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._closed = False

    def put(self, publisher: ext.AdvancedPublisher, payload: bytes) -> None:
        """Add a log entry to the queue of entries to be published; never blocks."""
        if self._closed or self._waiting.qsize() >= MAX_WAITING_ENTRIES:
            self._failed()
            return
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="entries", daemon=True)
            self._thread.start()
        self._waiting.put((publisher, payload))

    def close(self) -> None:
        """Publish the entries that still wait, for at most ``QUEUE_FLUSH_S`` seconds, and accept no more. Blocks meanwhile."""
        self._closed = True
        self._waiting.put(None)
        if self._thread is not None:
            self._thread.join(QUEUE_FLUSH_S)

    def _run(self) -> None:
        while (entry := self._waiting.get()) is not None:
            publisher, payload = entry
            try:
                publisher.put(payload)
            except zenoh.ZError:
                self._failed()
