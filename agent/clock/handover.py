"""A time that the agent hands over to its computer, which sets its clock by it: the agent itself must not."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from pathlib import Path
from typing import Annotated, NamedTuple

import msgspec

TIME_FILE = "time.json"  # in the agent's RUNTIME_DIRECTORY
_MOST_BYTES = 256
_LONGEST_S = 1e9  # 30 years


class Told(msgspec.Struct, frozen=True, kw_only=True):
    """The autopilot's time, as the agent has received it, for setting the computer's clock.

    ``utc_ns``: the autopilot's time at ``uptime_s`` of this computer's monotonic clock, which no setting changes.
    """

    utc_ns: int
    uptime_s: Annotated[float, msgspec.Meta(ge=0.0, le=_LONGEST_S)]

    def at(self, uptime_s: float) -> int:
        """Return the time, UTC in nanoseconds, when the monotonic clock shows ``uptime_s``."""
        return self.utc_ns + round((uptime_s - self.uptime_s) * 1e9)


class Valid(NamedTuple):
    """The interval of times (UTC, ns) that are plausible for the computer's clock."""

    begin_ns: int
    end_ns: int

    def __contains__(self, at_ns: object) -> bool:
        """Return whether a time (UTC, ns) is in the interval."""
        return isinstance(at_ns, int) and self.begin_ns <= at_ns < self.end_ns


def hand_over(folder: Path, told: Told) -> None:
    """Write the autopilot's time to a file, on which the system service radron-clock.path waits. A reader sees all of it or
    nothing.

    Raises:
        OSError: it cannot be written.
    """
    fresh = folder / f"{TIME_FILE}.new"
    fresh.write_bytes(msgspec.json.encode(told))
    fresh.replace(folder / TIME_FILE)


def taken(file: Path) -> Told | None:
    """Read the autopilot's time that the agent has handed over, and remove the file; None: no readable time.

    The agent is not trusted with the file: links are not followed, pipes not waited for, and no more is read than a time needs.
    """
    try:
        with os.fdopen(os.open(file, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as opened:
            return msgspec.json.decode(opened.read(_MOST_BYTES), type=Told)
    except (OSError, msgspec.MsgspecError):
        return None
    finally:
        with suppress(OSError):
            file.unlink()


def text(at_ns: int) -> str:
    """Return a time (UTC, ns) as text for people."""
    try:
        return time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(at_ns * 1e-9))
    except (OverflowError, ValueError, OSError):
        return "no time at all"
