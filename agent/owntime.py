"""The two times of an agent: its own, which is monotonic, and UTC at its border, where the computer's clock may be set.

Own time is UTC at the agent's start, and monotonic from then on. All stamps and timers inside the agent are own time. UTC exists
in messages, log entries, feeds, certificates and the state file, and is converted there, once.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

from msgspec.structs import replace

from radron.protocol.message import Message

M = TypeVar("M", bound=Message)
STEP_NS = 1_000_000  # less is the time between two readings: a slew changes both clocks of a computer
_MAX_READING_NS = 100_000  # a longer reading was interrupted, and is repeated
_READINGS = 3


class Utc:
    """UTC by the clock of an agent's computer. ``ahead_ns``: its lead over own time, the sum of its steps since the start."""

    def __init__(self) -> None:
        self.ahead_ns = 0

    def of(self, own_ns: int) -> int:
        """Return the UTC of an own time."""
        return own_ns + self.ahead_ns

    def own_ns(self, utc_ns: int) -> int:
        """Return the own time of a UTC."""
        return utc_ns - self.ahead_ns

    def stamped(self, message: M) -> M:
        """Return a message of this drone, made in own time, with its stamp in UTC; never before 1970."""
        return replace(message, stamp_ns=max(0, self.of(message.stamp_ns))) if self.ahead_ns else message


class OwnClock(Utc):
    """The clock of a process: own time, and the lead of UTC by both clocks of the computer."""

    def __init__(self, utc_ns: Callable[[], int] = time.time_ns, steady_ns: Callable[[], int] = time.monotonic_ns) -> None:
        super().__init__()
        self._utc_ns, self._steady_ns = utc_ns, steady_ns
        self._begin_ns = self._lead_ns()

    def now_ns(self) -> int:
        """Return the own time now."""
        return self._steady_ns() + self._begin_ns

    def look(self) -> int:
        """Read both clocks, and return the lead of UTC; less than ``STEP_NS`` is no step."""
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
