"""A set of sequence numbers, kept as ranges: small while the numbers have few gaps, as within one boot."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator

Range = tuple[int, int]  # first and last, both held


class SequenceSet:
    """A set of whole numbers, stored as ranges: small while the numbers have few gaps, as the numbers of a drone's log entries.

    The ranges are ascending and disjoint, and do not touch.
    """

    __slots__ = ("_firsts", "_lasts")

    def __init__(self, ranges: Iterable[Range] = ()) -> None:
        self._firsts: list[int] = []
        self._lasts: list[int] = []
        for first, last in sorted(ranges):
            if self._lasts and first <= self._lasts[-1] + 1:
                self._lasts[-1] = max(self._lasts[-1], last)
            else:
                self._firsts.append(first)
                self._lasts.append(last)

    def add(self, number: int) -> None:
        """Add a number; a number that is in the set already changes nothing."""
        if self._lasts and number == self._lasts[-1] + 1:  # the usual order of numbers
            self._lasts[-1] = number
        else:
            self.add_range(number, number)

    def add_range(self, first: int, last: int) -> None:
        """Add all numbers from ``first`` to ``last``."""
        begin, end = bisect_left(self._lasts, first - 1), bisect_right(self._firsts, last + 1)  # ranges that it meets or touches
        if begin < end:
            first, last = min(first, self._firsts[begin]), max(last, self._lasts[end - 1])
        self._firsts[begin:end], self._lasts[begin:end] = [first], [last]

    def discard(self, number: int) -> None:
        """Remove a number; a number that is not in the set changes nothing."""
        place = bisect_right(self._firsts, number) - 1
        if place < 0 or number > self._lasts[place]:
            return
        first, last = self._firsts[place], self._lasts[place]
        left = [(start, end) for start, end in ((first, number - 1), (number + 1, last)) if start <= end]
        self._firsts[place : place + 1] = [start for start, _ in left]
        self._lasts[place : place + 1] = [end for _, end in left]

    def __contains__(self, number: int) -> bool:
        place = bisect_right(self._firsts, number)
        return place > 0 and number <= self._lasts[place - 1]

    def meets(self, first: int, last: int) -> bool:
        """Return whether any number from ``first`` to ``last`` is in the set."""
        place = bisect_right(self._firsts, last)
        return place > 0 and self._lasts[place - 1] >= first

    def range_of(self, number: int) -> Range:
        """Return the stored range that contains a number. Raises KeyError if the number is not in the set."""
        place = bisect_right(self._firsts, number) - 1
        if place < 0 or number > self._lasts[place]:
            raise KeyError(number)
        return self._firsts[place], self._lasts[place]

    def __iter__(self) -> Iterator[Range]:
        return zip(self._firsts, self._lasts, strict=True)

    def within(self, first: int, last: int) -> Iterator[int]:
        """Yield the numbers of the set from ``first`` to ``last``, ascending; the cost does not depend on other numbers."""
        for place in range(bisect_left(self._lasts, first), bisect_right(self._firsts, last)):
            yield from range(max(first, self._firsts[place]), min(last, self._lasts[place]) + 1)

    def without(self, other: SequenceSet) -> Iterator[Range]:
        """Yield the numbers of this set that are not in ``other``, as ranges.

        The cost follows from the size of the result, not from the size of ``other``.
        """
        at = 0
        while at < len(self._firsts):
            start, last = self._firsts[at], self._lasts[at]
            place = bisect_right(other._firsts, start)
            if place and other._lasts[place - 1] >= last:
                at = bisect_right(self._lasts, other._lasts[place - 1], lo=at + 1)
                continue
            if place:
                start = max(start, other._lasts[place - 1] + 1)
            while start <= last:
                if place == len(other._firsts) or other._firsts[place] > last:
                    yield start, last
                    break
                if start < other._firsts[place]:
                    yield start, other._firsts[place] - 1
                start = other._lasts[place] + 1
                place += 1
            at += 1
