"""By how much the clock of one drone was wrong, as far as it has told with its exposures.

At the stamp of a sighting by it, or of it, the other one of the two was somewhere else then.

A drone learns only after a few seconds that its clock has been set, from the statuses of the others; what it measures until then
has wrong stamps, too. So what all its exposures of a while later tell counts for the time before.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from math import dist

from protocol.entries import LONGEST_EXPOSURE_NS, Exposure

# A status a second and its answer, with some of them lost; and the time, two exposures and more, in which all must tell it.
_LEARNED_NS, _TOLD_NS = 4_000_000_000, 1_200_000_000
_SLOWEST_MPS = 0.5  # of a drone that hovers the told error of the position says little of the clock's
_Told = tuple[int, int, float]  # begin and end of an exposure, and the error in seconds


class ClockErrors:
    """Of one drone, by its exposures in order of time."""

    def __init__(self) -> None:
        self._told: list[_Told] = []
        self._wrong = 0  # how many of them tell an error

    def add(self, exposure: Exposure) -> None:
        """Take what an exposure tells."""
        told = _told(exposure)
        insort(self._told, told)
        self._wrong += told[2] > 0.0

    def remove(self, exposure: Exposure) -> None:
        """Take it back."""
        told = _told(exposure)
        place = bisect_left(self._told, told)
        if self._told[place : place + 1] == [told]:
            del self._told[place]
            self._wrong -= told[2] > 0.0

    def drop_before(self, stamp_ns: int) -> None:
        """Discard exposures that ended before that stamp."""
        self._told = [told for told in self._told if told[1] >= stamp_ns]
        self._wrong = sum(error_s > 0.0 for _, _, error_s in self._told)

    def reach_ns(self, exposure: Exposure) -> int:
        """How long before an exposure that is held the error that ``at`` tells may depend on it: only where it tells an error, or
        one does that is told with it by all of a while.
        """
        if not self._wrong:
            return 0
        beside = self._within(exposure.stamp_ns - _TOLD_NS, exposure.end_ns + _TOLD_NS)
        return _LEARNED_NS + _TOLD_NS if any(error_s > 0.0 for _, _, error_s in beside) else 0

    def at(self, stamp_ns: int) -> float:
        """The error (s) at a stamp, as told with the exposures of its time or of a while later; 0 where none was told."""
        if not self._wrong:
            return 0.0
        learned_ns = stamp_ns + _LEARNED_NS
        return max(self._least(stamp_ns, stamp_ns), self._least(learned_ns, learned_ns + _TOLD_NS))

    def content(self, after_ns: int, until_ns: int) -> tuple[object, ...]:
        """By value, all that the errors in (after_ns, until_ns] follow from; empty where there are none. For simulations, whose
        agents share what they compute.
        """
        if not self._wrong:
            return ()
        later = self._within(after_ns + _LEARNED_NS, until_ns + _LEARNED_NS + _TOLD_NS)
        told = *self._within(after_ns, until_ns), *later
        return told if any(error_s > 0.0 for _, _, error_s in told) else ()

    def _least(self, from_ns: int, until_ns: int) -> float:
        """The least error (s) told in any exposure of that time.

        Of several exposures at one time the least error counts: else one that lies could spare itself all sightings by
        exposures of its own for that, while its measurements come with others. One with a wrong clock tells it with all.
        """
        return min((error_s for _, _, error_s in self._within(from_ns, until_ns)), default=0.0)

    def _within(self, from_ns: int, until_ns: int) -> list[_Told]:
        """What the exposures tell that lie in that time, at least partly."""
        first = bisect_left(self._told, (from_ns - LONGEST_EXPOSURE_NS,))
        begun = self._told[first : bisect_right(self._told, until_ns, key=_begin_ns)]
        return [told for told in begun if from_ns <= told[1]]


def _begin_ns(told: _Told) -> int:
    return told[0]


def clock_error_s(exposure: Exposure) -> float:
    """The error (s) that an exposure tells; 0 where it tells none."""
    if exposure.clock_sigma_m == 0.0:
        return 0.0
    first, last = exposure.poses[0], exposure.poses[-1]
    elapsed_s = max(1e-9 * (last.offset_ns - first.offset_ns), 1e-3)
    speed_mps = dist(first.position_m, last.position_m) / elapsed_s
    return exposure.clock_sigma_m / max(speed_mps, _SLOWEST_MPS)


def _told(exposure: Exposure) -> _Told:
    return exposure.stamp_ns, exposure.end_ns, clock_error_s(exposure)
