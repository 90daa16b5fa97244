"""The queue of messages to one page: always bounded; of replaceable messages only the newest waits."""

from __future__ import annotations

import asyncio
import time
from collections import deque

MAX_WAITING = 400  # messages that a page must get: a page further behind is disconnected, and begins anew
MAX_PASSING = 20  # messages that a page can do without: the oldest are dropped first
MAX_AHEAD = 4  # frames sent and not drawn yet
LET_GO, GAVE_WAY = 1008, 4001  # close codes of a page's socket; only after the first the page connects again by itself


class Page:
    """Queue of messages to one open web page, which never grows without limit.

    A page reports each state that it has drawn. A page that draws or reads more slowly than states come gets fewer of them, each
    as new as possible, so that the queue does not grow, neither here nor in the buffers on the way. ``live``: the page follows
    the present; else it shows the past time ``at_ms``. ``used_s``: time of the operator's last request (monotonic clock).
    ``left``: set when the page must be disconnected, with the WebSocket close code ``code``.
    """

    def __init__(self) -> None:
        self.live = True
        self.at_ms: int | None = None
        self.used_s = time.monotonic()
        self.left, self.code = asyncio.Event(), LET_GO
        self._said: deque[bytes] = deque()
        self._passing: deque[bytes] = deque(maxlen=MAX_PASSING)
        self._newest: dict[str, bytes] = {}
        self._ahead = 0
        self._something = asyncio.Event()

    def send(self, data: bytes) -> None:
        """Queue a message that the page must get; a page too far behind is disconnected instead."""
        if len(self._said) < MAX_WAITING:
            self._said.append(data)
        else:
            self.leave(LET_GO)
        self._something.set()

    def use(self) -> None:
        """Record that the page's operator has just asked for something."""
        self.used_s = time.monotonic()

    def leave(self, code: int) -> None:
        """Disconnect the page with a WebSocket close code."""
        self.code = code
        self.left.set()

    def show(self, kind: str, data: bytes) -> None:
        """Queue a message that replaces all waiting messages of its ``kind``, such as a newer state of the swarm."""
        self._newest.pop(kind, None)
        self._newest[kind] = data
        self._something.set()

    def pass_by(self, data: bytes) -> None:
        """Queue a message that the page can do without; if more than ``MAX_PASSING`` wait, the oldest is dropped."""
        self._passing.append(data)
        self._something.set()

    def drawn(self) -> None:
        """Record that the page has drawn the newest state of the swarm that it has got."""
        self._ahead = 0
        self._something.set()

    async def next(self) -> bytes:
        """Wait for the next message to the page, and return it."""
        while (data := self.take()) is None:
            self._something.clear()
            await self._something.wait()
        return data

    def take(self) -> bytes | None:
        """Return the next message to the page; None if no waiting message may be sent now."""
        if self._said:
            return self._said.popleft()
        if self._ahead >= MAX_AHEAD:
            return None
        if self._passing:
            return self._passing.popleft()
        for kind in self._newest:
            self._ahead += kind == "frame"
            return self._newest.pop(kind)
        return None
