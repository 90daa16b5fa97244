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
    """An open page. ``live``: follows the present; else looks back, and shows ``at_ms``. ``used_s``: time of its operator's last
    request (monotonic clock). ``left``: to be disconnected, with ``code``.

    A page reports each drawn frame. A page that draws or reads more slowly than frames come gets fewer frames, each as new as
    possible: the queue does not grow, neither here nor in the buffers on the way.
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
        """Send an indispensable message; a page far behind is disconnected instead."""
        if len(self._said) < MAX_WAITING:
            self._said.append(data)
        else:
            self.leave(LET_GO)
        self._something.set()

    def use(self) -> None:
        """Note a request of the page's operator."""
        self.used_s = time.monotonic()

    def leave(self, code: int) -> None:
        """Disconnect the page with a close code."""
        self.code = code
        self.left.set()

    def show(self, kind: str, data: bytes) -> None:
        """Send a message that replaces all waiting messages of its kind."""
        self._newest.pop(kind, None)
        self._newest[kind] = data
        self._something.set()

    def pass_by(self, data: bytes) -> None:
        """Send a dispensable message: the oldest are dropped above ``MAX_PASSING``."""
        self._passing.append(data)
        self._something.set()

    def drawn(self) -> None:
        """Note that the page has drawn its newest frame."""
        self._ahead = 0
        self._something.set()

    async def next(self) -> bytes:
        """Wait for the next message and return it."""
        while (data := self.take()) is None:
            self._something.clear()
            await self._something.wait()
        return data

    def take(self) -> bytes | None:
        """Return the next message; None if no waiting message may be sent now."""
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
