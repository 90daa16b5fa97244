"""The two times of an agent: its own, which is monotonic, and UTC at its border, where the computer's clock may be set.

Own time is UTC at the agent's start, and monotonic from then on. All stamps and timers inside the agent are own time. UTC exists
in messages, log entries, feeds, certificates and the state file, and is converted there, once.
"""

from __future__ import annotations

from typing import TypeVar

from msgspec.structs import replace

from radron.protocol.message import Message

M = TypeVar("M", bound=Message)


class Utc:
    """Converts between an agent's own time, which never jumps, and UTC by its computer's clock, which may be set during a flight.

    ``ahead_ns``: time by which UTC is ahead of own time, the sum of the steps of the computer's clock since the agent's start.
    """

    def __init__(self) -> None:
        self.ahead_ns = 0

    def of(self, own_ns: int) -> int:
        """Convert an own time (ns) to UTC (ns)."""
        return own_ns + self.ahead_ns

    def own_ns(self, utc_ns: int) -> int:
        """Convert UTC (ns) to own time (ns)."""
        return utc_ns - self.ahead_ns

    def stamped(self, message: M) -> M:
        """Return a message of this drone with its time stamp converted from own time to UTC; never before 1970."""
        return replace(message, stamp_ns=max(0, self.of(message.stamp_ns))) if self.ahead_ns else message
