"""Texts (STATUSTEXT) on one link of an emulated vehicle: to ground stations only, one at a time from a queue, in chunks."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

from pymavlink.dialects.v20 import common as mavlink

from radron.sim.vehicle.px4.state import Message

BEGIN_S = 2.85  # after the start: time of the first text
EVERY_S = 0.048  # between two texts
STALE_S = 5.0  # older ones are dropped
STATION_GONE_S = 2.5  # after so long without its heartbeat a link gets no more texts
_CHUNK = 50
_IDS = 65_536


class Texts:
    """Queue of the texts on one link. ``station_s``: last heartbeat of a ground station, by the vehicle's clock."""

    def __init__(self) -> None:
        self.station_s: float | None = None
        self._queue: deque[tuple[float, int, str]] = deque()
        self._number = 0  # the first is 0, which marks it as single, whatever its length
        self._next_s = BEGIN_S

    def say(self, severity: int, text: str, now_s: float) -> None:
        """Add a text to the queue."""
        self._queue.append((now_s, severity, text))

    def due(self, now_s: float) -> Iterator[Message]:
        """Yield the messages of the next text, if it is due and a ground station is present."""
        while self._queue and now_s - self._queue[0][0] > STALE_S:
            self._queue.popleft()
        present = self.station_s is not None and now_s - self.station_s < STATION_GONE_S
        if not self._queue or not present or now_s < self._next_s:
            return
        _, severity, text = self._queue.popleft()
        self._next_s = now_s + EVERY_S
        content = text.encode()
        for chunk, begin in enumerate(range(0, len(content), _CHUNK)):
            yield mavlink.MAVLink_statustext_message(severity, content[begin : begin + _CHUNK], self._number, chunk)
        self._number = (self._number + 1) % _IDS
