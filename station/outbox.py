"""What waits for one page: bounded, whatever the page does; of what is replaced by newer ones, only the newest."""

from __future__ import annotations

import asyncio
from collections import deque

MOST_WAITING = 400  # messages that a page must get: if it is further behind it is let go, and begins anew
MOST_PASSING = 20  # messages that a page can do without: then the oldest are dropped
MOST_AHEAD = 4  # frames that were sent and are not drawn yet


class Page:
    """An open page. ``live``: it follows the present; else it looks back, and shows ``at_ms``.

    A page tells when it has drawn a frame. One that draws or reads more slowly than frames come gets fewer of them, each as new
    as it can be: what waits does not grow, neither here nor in the buffers on the way.
    """

    def __init__(self) -> None:
        self.live = True
        self.at_ms: int | None = None
        self.gone = False  # it reads too slowly
        self._said: deque[bytes] = deque()
        self._passing: deque[bytes] = deque(maxlen=MOST_PASSING)
        self._newest: dict[str, bytes] = {}
        self._ahead = 0
        self._something = asyncio.Event()

    def send(self, data: bytes) -> None:
        """Send what it must get, unless it is far behind: then it is let go."""
        if len(self._said) < MOST_WAITING:
            self._said.append(data)
        else:
            self.gone = True
        self._something.set()

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
        if self._ahead >= MOST_AHEAD:
            return None
        if self._passing:
            return self._passing.popleft()
        for kind in self._newest:
            self._ahead += kind == "frame"
            return self._newest.pop(kind)
        return None
