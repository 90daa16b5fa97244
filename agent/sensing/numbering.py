"""Sequence numbers of the own log entries: the numbers given since a time, and those given with a wrong clock.

A clock that is set back may have been wrong before, or be wrong from then on. Once the others' clocks confirm it, its wrongly
stamped entries are taken back. After a forward step by the same amount these are all entries since then. Otherwise they are the
entries with later stamps than the time to which it was set back. If the clock reaches these stamps again first, nothing is taken
back.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from msgspec import Struct

from radron.agent.owntime import Utc

_SET_BACK_NS = 1_000_000_000  # by less, stamps are hardly wrong
_ALIKE_NS = 1_000_000_000  # difference of two steps of a clock that undo each other: drift
_NOTED_NS = 1_000_000_000
_MOST_NOTED, _MOST_STEPS = 600, 8


class _Doubted(Struct, frozen=True):
    """Numbers of entries whose stamps may be wrong, and the latest UTC by the clock before it was set back."""

    first: int
    last: int
    until_ns: int


class _Noted(NamedTuple):
    """A time, and the next number then."""

    own_ns: int
    utc_ns: int
    number: int


class Numbering(Iterator[int]):
    """Gives the sequence numbers of this drone's log entries, from 1 on, and remembers which were given at which time.

    With this memory, entries made with a wrong clock can be taken back.
    """

    def __init__(self, utc: Utc) -> None:
        self._next, self._utc = 1, utc
        self._noted: deque[_Noted] = deque(maxlen=_MOST_NOTED)  # one for each second
        self._ahead: deque[tuple[int, int]] = deque(maxlen=_MOST_STEPS)  # the next number at a step ahead, and the step
        self._doubted: _Doubted | None = None
        self._told = 1, 1  # the first number returned by ``since``, and the next number after that and its retraction

    def __next__(self) -> int:
        """Return the next sequence number."""
        number, self._next = self._next, self._next + 1
        return number

    def note(self, now_ns: int) -> None:
        """Note the next number of each second."""
        if self._doubted is not None and self._utc.of(now_ns) >= self._doubted.until_ns:
            self._doubted = None
        if not self._noted or now_ns - self._noted[-1].own_ns >= _NOTED_NS:
            self._noted.append(_Noted(now_ns, self._utc.of(now_ns), self._next))

    def clock_step(self, by_ns: int, now_ns: int) -> None:
        """Note a step of the own clock, before numbers are given by its new time."""
        if by_ns > _SET_BACK_NS:
            self._ahead.append((self._next, by_ns))
        elif by_ns < -_SET_BACK_NS:
            self._set_back(-by_ns, now_ns)

    def _set_back(self, back_ns: int, now_ns: int) -> None:
        before_ns = self._utc.of(now_ns) + back_ns
        later, ahead = self._first_later_than(self._utc.of(now_ns)), self._first_ahead_by(back_ns)
        first = later if ahead is None else ahead
        if self._doubted is not None:
            first, before_ns = min(first, self._doubted.first), max(before_ns, self._doubted.until_ns)
        if first < self._next:
            self._doubted = _Doubted(first, self._next - 1, before_ns)

    def _first_later_than(self, utc_ns: int) -> int:
        """Return the first number with a later stamp; such stamps are judged once."""
        first = next((one.number for one in self._noted if one.utc_ns > utc_ns), self._next)
        self._noted = deque((one._replace(utc_ns=min(one.utc_ns, utc_ns)) for one in self._noted), _MOST_NOTED)
        return first

    def _first_ahead_by(self, back_ns: int) -> int | None:
        """The first number since the clock was last set ahead by as much, which is undone; None if it was not."""
        alike = [place for place, (_, step_ns) in enumerate(self._ahead) if abs(back_ns - step_ns) <= _ALIKE_NS]
        if not alike:
            return None
        first = self._ahead[alike[-1]][0]
        while len(self._ahead) > alike[-1]:
            self._ahead.pop()
        return first

    def since(self, stamp_ns: int) -> tuple[int, int] | None:
        """Return the first and the last number given since a time (ns), or up to a second earlier.

        Return None if all of them have been returned before. The entries are taken back with the next number, so that a
        localisation that jumps all the time repeats no retraction.
        """
        earlier = [one.number for one in self._noted if one.own_ns <= stamp_ns]
        first, (told_first, told_next) = earlier[-1] if earlier else 1, self._told
        if told_first <= first < told_next:
            first = told_next
        if first >= self._next:
            return None
        self._told = told_first if first == told_next else first, self._next + 1
        return first, self._next - 1

    def wrong(self) -> tuple[int, int] | None:
        """Return the first and the last number of entries with stamps of a wrong clock, once, after the clock is known to be
        right.

        Return None without such entries.
        """
        doubted, self._doubted = self._doubted, None
        return None if doubted is None else (doubted.first, doubted.last)
