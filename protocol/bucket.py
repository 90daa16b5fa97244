"""A token bucket: limits of a burst and of a mean rate."""

from __future__ import annotations


class Bucket:
    """Token bucket: limits a stream of events to a mean rate, with a limited burst.

    The bucket starts full with ``burst`` tokens and gains ``rate`` tokens a second. Times are of any clock, in seconds; a
    backward step of the clock adds no tokens. The level may become negative (a debt), and later calls of :meth:`take` then fail
    until the level has recovered.
    """

    __slots__ = ("_at_s", "_burst", "_level", "_rate")

    def __init__(self, rate: float, burst: float, now_s: float) -> None:
        self._rate, self._burst, self._level, self._at_s = rate, burst, burst, now_s

    def left(self, now_s: float) -> float:
        """Return the number of tokens at the time ``now_s``; negative: a debt."""
        self._level = min(self._burst, self._level + self._rate * max(0.0, now_s - self._at_s))
        self._at_s = now_s
        return self._level

    def charge(self, amount: float) -> None:
        """Remove tokens at any level, even if this makes the level negative."""
        self._level -= amount

    def take(self, now_s: float, amount: float = 1.0) -> bool:
        """Remove ``amount`` tokens if the bucket contains as many; return whether it did."""
        if self.left(now_s) < amount:
            return False
        self._level -= amount
        return True
