"""A clock for the age of orders, which must not be executed late."""

from __future__ import annotations

import time

_CLOCK = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)


def elapsed_s() -> float:
    """Return the time since the computer's start, in seconds.

    Unlike the monotonic clock, it continues while the computer sleeps, so that an order cannot be executed too late after a
    sleep.
    """
    return time.clock_gettime(_CLOCK)
