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
