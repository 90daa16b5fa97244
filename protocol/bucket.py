"""A token bucket: how much of something may be done at once, and how much over time."""

from __future__ import annotations


class Bucket:
    """Is full at first, with ``burst``, and gains ``rate`` a second. The time is given, s, of any clock; one that is set back
    adds nothing. It may be in debt: what is charged is charged, and the next has to wait.
    """

    __slots__ = ("_at_s", "_burst", "_level", "_rate")

    def __init__(self, rate: float, burst: float, now_s: float) -> None:
        self._rate, self._burst, self._level, self._at_s = rate, burst, burst, now_s

    def left(self, now_s: float) -> float:
        """What may be taken now; negative: the debt."""
        self._level = min(self._burst, self._level + self._rate * max(0.0, now_s - self._at_s))
        self._at_s = now_s
        return self._level

    def charge(self, amount: float) -> None:
        """Take, whatever is left."""
        self._level -= amount

    def take(self, now_s: float, amount: float = 1.0) -> bool:
        """Take if there is as much; whether there was."""
        if self.left(now_s) < amount:
            return False
        self._level -= amount
        return True
