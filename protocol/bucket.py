"""A token bucket: limits of a burst and of a mean rate."""

from __future__ import annotations


class Bucket:
    """A bucket that starts full, with ``burst``, and gains ``rate`` a second.

    Times are of any clock (s); a clock step backward adds nothing. The level may be negative (a debt), and later calls then
    wait for its recovery.
    """

    __slots__ = ("_at_s", "_burst", "_level", "_rate")

    def __init__(self, rate: float, burst: float, now_s: float) -> None:
        self._rate, self._burst, self._level, self._at_s = rate, burst, burst, now_s

    def left(self, now_s: float) -> float:
        """Return the level at this time; negative: a debt."""
        self._level = min(self._burst, self._level + self._rate * max(0.0, now_s - self._at_s))
        self._at_s = now_s
        return self._level

    def charge(self, amount: float) -> None:
        """Take an amount at any level, even into debt."""
        self._level -= amount

    def take(self, now_s: float, amount: float = 1.0) -> bool:
        """Take an amount if the level allows it; return whether it did."""
        if self.left(now_s) < amount:
            return False
        self._level -= amount
        return True
