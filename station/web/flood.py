"""How much the other end of a socket may say."""

from __future__ import annotations

import time

_PER_SECOND = 50.0  # messages
_BURST = 100.0


class Credit:
    """Of one socket."""

    def __init__(self) -> None:
        self._left, self._since_s = _BURST, time.monotonic()

    def spend(self, messages: float = 1.0) -> bool:
        """Count a message, or one that costs as much as several; False: there have been too many."""
        now_s = time.monotonic()
        self._left = min(_BURST, self._left + _PER_SECOND * (now_s - self._since_s)) - messages
        self._since_s = now_s
        return self._left >= 0.0
