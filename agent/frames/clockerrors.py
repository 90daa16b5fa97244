"""Clock error of one drone, as published with its exposures.

With a wrong clock, the other drone of a sighting was at another place at the sighting's stamp.

A drone learns of a step of its clock only after a few seconds, from its peers' statuses; measurements until then have wrong
stamps, too. The error in all its exposures of a while later therefore also counts for the time before.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from math import dist

from radron.protocol.entries import MAX_READABLE_EXPOSURE_NS, Exposure

# A status a second and its answer, with some of them lost; and the time, two exposures and more, in which all must state it.
_LEARNED_NS, _TOLD_NS = 4_000_000_000, 1_200_000_000
_SLOWEST_MPS = 0.5  # for a hovering drone the published error of the position says little about the clock's
_Told = tuple[int, int, float]  # begin and end of an exposure, and the error in seconds


class ClockErrors:
    """The errors of one drone's clock over time, as the drone has published them with its exposures (counts of the camera)."""

    def __init__(self) -> None:
        self._told: list[_Told] = []
        self._wrong = 0  # number of exposures with an error

    def add(self, exposure: Exposure) -> None:
        """Add the clock error that the drone has published with an exposure (counts of its camera)."""
        told = _told(exposure)
        insort(self._told, told)
        self._wrong += told[2] > 0.0

    def remove(self, exposure: Exposure) -> None:
        """Remove the clock error that came with an exposure (counts of the drone's camera)."""
        told = _told(exposure)
        place = bisect_left(self._told, told)
        if self._told[place : place + 1] == [told]:
            del self._told[place]
            self._wrong -= told[2] > 0.0

    def drop_before(self, stamp_ns: int) -> None:
        """Discard the clock errors of exposures (counts of the drone's camera) that ended before a time stamp (ns)."""
        self._told = [told for told in self._told if told[1] >= stamp_ns]
        self._wrong = sum(error_s > 0.0 for _, _, error_s in self._told)

    def reach_ns(self, exposure: Exposure) -> int:
        """Return the time (ns) before an exposure in which the result of ``at`` may depend on the exposure.

        Return 0 if neither this exposure nor another one within ``_TOLD_NS`` has an error.
        """
        if not self._wrong:
            return 0
        beside = self._within(exposure.stamp_ns - _TOLD_NS, exposure.end_ns + _TOLD_NS)
        return _LEARNED_NS + _TOLD_NS if any(error_s > 0.0 for _, _, error_s in beside) else 0

    def at(self, stamp_ns: int) -> float:
        """Return the clock's error (s) at a time stamp, as published with the exposures of this time or a while later; 0 without
        one.
        """
        if not self._wrong:
            return 0.0
        learned_ns = stamp_ns + _LEARNED_NS
        return max(self._least(stamp_ns, stamp_ns), self._least(learned_ns, learned_ns + _TOLD_NS))

    def content(self, after_ns: int, until_ns: int) -> tuple[object, ...]:
        """Return all inputs of the errors in (after_ns, until_ns] as one value that can be compared and hashed; empty without
        errors.

        Simulations use the value to share results between agents: equal inputs give equal results.
        """
        if not self._wrong:
            return ()
        later = self._within(after_ns + _LEARNED_NS, until_ns + _LEARNED_NS + _TOLD_NS)
        told = *self._within(after_ns, until_ns), *later
        return told if any(error_s > 0.0 for _, _, error_s in told) else ()

    def _least(self, from_ns: int, until_ns: int) -> float:
        """The least error (s) in any exposure of that time.

        Of several exposures at one time the least error counts. Otherwise a malicious drone could void all its sightings by
        additional exposures, while its measurements come with others. A drone with a wrong clock states the error in all.
        """
        return min((error_s for _, _, error_s in self._within(from_ns, until_ns)), default=0.0)

    def _within(self, from_ns: int, until_ns: int) -> list[_Told]:
        """Errors of the exposures that overlap that time."""
        first = bisect_left(self._told, (from_ns - MAX_READABLE_EXPOSURE_NS,))
        begun = self._told[first : bisect_right(self._told, until_ns, key=_begin_ns)]
        return [told for told in begun if from_ns <= told[1]]


def _begin_ns(told: _Told) -> int:
    return told[0]


def clock_error_s(exposure: Exposure) -> float:
    """Return the clock error (s) that is published in an exposure, from position error and speed; 0 without one."""
    if exposure.clock_sigma_m == 0.0:
        return 0.0
    first, last = exposure.poses[0], exposure.poses[-1]
    elapsed_s = max(1e-9 * (last.offset_ns - first.offset_ns), 1e-3)
    speed_mps = dist(first.position_m, last.position_m) / elapsed_s
    return exposure.clock_sigma_m / max(speed_mps, _SLOWEST_MPS)


def _told(exposure: Exposure) -> _Told:
    return exposure.stamp_ns, exposure.end_ns, clock_error_s(exposure)
