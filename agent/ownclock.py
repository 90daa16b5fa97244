"""The clock of an agent's process: own time, and the lead of UTC over it, by the two clocks of its computer."""

from __future__ import annotations

import time
from collections.abc import Callable

from radron.agent.owntime import Utc

STEP_NS = 1_000_000  # less is the time between two readings: a slew changes both clocks of a computer
_MAX_READING_NS = 100_000  # a longer reading was interrupted, and is repeated
_READINGS = 3


class OwnClock(Utc):
    """The clock of an agent's process, which gives a time that never jumps (own time), and finds steps of the computer's UTC
    clock.
    """

    def __init__(self, utc_ns: Callable[[], int] = time.time_ns, steady_ns: Callable[[], int] = time.monotonic_ns) -> None:
        super().__init__()
        self._utc_ns, self._steady_ns = utc_ns, steady_ns
        self._begin_ns = self._lead_ns()

    def now_ns(self) -> int:
        """Return the present own time (ns): UTC at the start of the process, and from then on the monotonic clock."""
        return self._steady_ns() + self._begin_ns

    def look(self) -> int:
        """Read both clocks of the computer, and return the time (ns) by which UTC is ahead of own time.

        A difference of less than ``STEP_NS`` since the last reading does not count as a step of the clock.
        """
        ahead_ns = self._lead_ns() - self._begin_ns
        if abs(ahead_ns - self.ahead_ns) > STEP_NS:
            self.ahead_ns = ahead_ns
        return self.ahead_ns

    def _lead_ns(self) -> int:
        """Return the lead of UTC over the monotonic clock."""
        for _ in range(_READINGS):
            before_ns, utc_ns, after_ns = self._steady_ns(), self._utc_ns(), self._steady_ns()
            if after_ns - before_ns <= _MAX_READING_NS:
                break
        return utc_ns - before_ns
