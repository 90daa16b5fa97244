"""Rate limit for the messages received on a socket."""

from __future__ import annotations

import time

_PER_SECOND = 50.0  # messages
_BURST = 100.0


class Credit:
    """Limits the rate of messages received on one socket, by a token bucket (mean rate with a limited burst)."""

    def __init__(self) -> None:
        self._left, self._since_s = _BURST, time.monotonic()

    def spend(self, messages: float = 1.0) -> bool:
        """Count a received message; return False if the rate limit is exceeded. ``messages``: cost of an expensive message."""
        now_s = time.monotonic()
        self._left = min(_BURST, self._left + _PER_SECOND * (now_s - self._since_s)) - messages
        self._since_s = now_s
        return self._left >= 0.0
