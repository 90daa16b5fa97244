"""For how long a condition has held without a break."""

from __future__ import annotations


def since(before_ns: int | None, now_ns: int, *, holds: bool) -> int | None:
    """Return when the condition began to hold; None while it does not. ``before_ns``: the result of the step before."""
    return begun(before_ns, now_ns) if holds else None


def begun(before_ns: int | None, now_ns: int) -> int:
    """Return when a condition that holds began. A time in the future is from before a clock step backward, and counts anew."""
    return now_ns if before_ns is None or before_ns > now_ns else before_ns
