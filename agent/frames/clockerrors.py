"""By how much the clock of one drone was wrong, as far as it has told with its exposures.

At the stamp of a sighting by it, or of it, the other one of the two was somewhere else then.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from math import dist, inf

from protocol.entries import Exposure

_SLOWEST_MPS = 0.5  # of a drone that hovers the told error of the position says little of the clock's
_Told = tuple[int, int, float]  # begin and end of an exposure, and the error in seconds


class ClockErrors:
    """Of one drone, in order of time; empty while its clock is right."""

    def __init__(self) -> None:
        self._told: list[_Told] = []

    def add(self, exposure: Exposure) -> None:
        """Take what an exposure tells."""
        if exposure.clock_sigma_m > 0.0:
            insort(self._told, _told(exposure))

    def remove(self, exposure: Exposure) -> None:
        """Take it back."""
        told = _told(exposure)
        place = bisect_left(self._told, told)
        if self._told[place : place + 1] == [told]:
            del self._told[place]

    def drop_before(self, stamp_ns: int) -> None:
        """Discard exposures that began before that stamp."""
        del self._told[: bisect_left(self._told, (stamp_ns, 0, 0.0))]

    def at(self, stamp_ns: int) -> float:
        """The error (s) at a stamp; 0 where none was told."""
        place = bisect_right(self._told, (stamp_ns, 2**63, inf))
        if place == 0:
            return 0.0
        _, end_ns, error_s = self._told[place - 1]
        return error_s if stamp_ns <= end_ns else 0.0


def _told(exposure: Exposure) -> _Told:
    first, last = exposure.poses[0], exposure.poses[-1]
    elapsed_s = max(1e-9 * (last.offset_ns - first.offset_ns), 1e-3)
    speed_mps = dist(first.position_m, last.position_m) / elapsed_s
    return exposure.stamp_ns, exposure.end_ns, exposure.clock_sigma_m / max(speed_mps, _SLOWEST_MPS)
