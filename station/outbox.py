"""What waits for one page: bounded, whatever the page does; of what is replaced by newer ones, only the newest."""

from __future__ import annotations

import asyncio
import time
from collections import deque

MAX_WAITING = 400  # messages that a page must get: if it is further behind it is let go, and begins anew
MAX_PASSING = 20  # messages that a page can do without: then the oldest are dropped
MAX_AHEAD = 4  # frames that were sent and are not drawn yet
LET_GO, GAVE_WAY = 1008, 4001  # codes with which a page's socket is closed; it connects again by itself only after the first


class Page:
    """An open page. ``live``: it follows the present; else it looks back, and shows ``at_ms``. ``used_s``: when its operator last
    asked for something (monotonic clock). ``left``: it is let go, with ``code``.

    A page tells when it has drawn a frame. One that draws or reads more slowly than frames come gets fewer of them, each as new
    as it can be: what waits does not grow, neither here nor in the buffers on the way.
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
        """Send what it must get, unless it is far behind: then it is let go."""
        if len(self._said) < MAX_WAITING:
            self._said.append(data)
        else:
            self.leave(LET_GO)
        self._something.set()

    def use(self) -> None:
        """Note that its operator has asked for something."""
        self.used_s = time.monotonic()

    def leave(self, code: int) -> None:
        """Let it go."""
        self.code = code
        self.left.set()

    def show(self, kind: str, data: bytes) -> None:
        """Send what takes the place of everything of its kind."""
        self._newest.pop(kind, None)
        self._newest[kind] = data
        self._something.set()

    def pass_by(self, data: bytes) -> None:
        """Send what may be dropped where much of it waits."""
        self._passing.append(data)
        self._something.set()

    def drawn(self) -> None:
        """It has drawn the newest frame that it got."""
        self._ahead = 0
        self._something.set()

    async def next(self) -> bytes:
        """The next message, once there is one."""
        while (data := self.take()) is None:
            self._something.clear()
            await self._something.wait()
        return data

    def take(self) -> bytes | None:
        """The next message; None where none waits that may be sent now."""
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
