"""For how long a condition has held without a break."""

from __future__ import annotations


def since(before_ns: int | None, now_ns: int, *, holds: bool) -> int | None:
    """Return the time (ns) since which a condition holds without a break; None while it does not hold.

    before_ns: the result of the previous call. now_ns: the present time.
    """
    return begun(before_ns, now_ns) if holds else None


def begun(before_ns: int | None, now_ns: int) -> int:
    """Return the time (ns) at which a condition that holds now began.

    before_ns: the result of the previous call; a time in the future is from before a backward step of the clock, and the
    condition counts as new.
    """
    return now_ns if before_ns is None or before_ns > now_ns else before_ns
