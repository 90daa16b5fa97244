"""For how long a condition has held without a break."""

from __future__ import annotations


def since(before_ns: int | None, now_ns: int, *, holds: bool) -> int | None:
    """Return the time (ns) since which a condition holds without a break; None while it does not hold.

    before_ns: the result of the previous call. now_ns: the present time.
    """
    return (now_ns if before_ns is None else before_ns) if holds else None
