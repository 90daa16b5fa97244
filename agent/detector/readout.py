"""Timepix3 readouts: the interface between a detector (real, recorded or simulated) and the agent."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterable
from typing import Protocol

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

SENSOR_PIXELS = 256
PIXEL_PITCH_MM = 0.055
SENSOR_THICKNESS_MM = 2.0
SATURATED_TOT = 1022  # the counter of 10 bits is full: the energy is a lower bound
PAUSE_TICKS = 160  # 250 ns without a hit: longer than any window of an event
TICK_NS = 25.0 / 16.0  # one fine time-of-arrival step; tick = 16 ToA - FToA


class PixelHits(Struct, frozen=True):
    """Hits of the camera's pixels, N in total, in the order in which the camera delivered them: nearly, but not strictly, by
    time.

    tick: (N,) int64, time of arrival in steps of 25/16 ns since the detector's clock was reset. index: (N,) uint16, matrix index
    = 256 row + column, 0 at the lower left seen from the front. tot: (N,) uint16, time over threshold in 25 ns counts.
    """

    tick: NDArray[np.int64]
    index: NDArray[np.uint16]
    tot: NDArray[np.uint16]

    def __len__(self) -> int:
        return len(self.tick)

    @classmethod
    def none(cls) -> PixelHits:
        """Return an empty set of pixel hits."""
        return cls(np.empty(0, np.int64), np.empty(0, np.uint16), np.empty(0, np.uint16))

    @classmethod
    def joined(cls, parts: Iterable[PixelHits]) -> PixelHits:
        """Return the pixel hits of all parts as one sequence, part after part; without parts the result has no hits."""
        hits = (cls.none(), *parts)
        return cls(
            np.concatenate([part.tick for part in hits]),
            np.concatenate([part.index for part in hits]),
            np.concatenate([part.tot for part in hits]),
        )

    def take(self, which: NDArray[np.bool_] | NDArray[np.intp] | slice) -> PixelHits:
        """Return the pixel hits that a mask, indices or a slice select."""
        return PixelHits(self.tick[which], self.index[which], self.tot[which])


class Readout(Struct, frozen=True):
    """All hits that a detector measured in the interval [start_ns, end_ns), own time. The intervals of a detector are contiguous.

    ``clock_ns`` is the time of tick 0. ``live_time_s`` excludes dead time. ``lost_hits`` counts hits that the detector
    reported as lost (overflow), ``repaired_hits`` hits that its reader moved to the neighbouring period of the chip's counter.
    ``counts``: only of an ordinary detector, which has no pixels: (R,) int64, its counts in each of its own channels.
    """

    start_ns: int
    end_ns: int
    clock_ns: int
    live_time_s: float
    hits: PixelHits
    lost_hits: int = 0
    repaired_hits: int = 0
    counts: NDArray[np.int64] | None = None

    def moved(self, by_ns: int) -> Readout:
        """Return the same readout with all times later by ``by_ns``."""
        if by_ns == 0:
            return self
        return replace(self, start_ns=self.start_ns + by_ns, end_ns=self.end_ns + by_ns, clock_ns=self.clock_ns + by_ns)


def shed(readout: Readout, most: int) -> Readout:
    """Shorten a readout (pixel hits of one interval) so that it has at most ``most`` hits, for a computer that cannot keep up;
    the later hits count as lost.

    The cut lies in a pause between hits, so that no event is cut in two. Without a pause it lies at the first excess hit. The
    live time is shared by number of hits, not by time: the readout itself may have been dead for a part of it.
    """
    hits = readout.hits
    if len(hits) <= most:
        return readout
    tick = np.sort(hits.tick, kind="stable")[: most + 1]
    pauses = np.flatnonzero(np.diff(tick) > PAUSE_TICKS)
    kept = hits.take(hits.tick < (tick[pauses[-1] + 1] if len(pauses) else tick[most]))
    lost = len(hits) - len(kept)
    live_s = readout.live_time_s * len(kept) / len(hits)
    return replace(readout, live_time_s=live_s, hits=kept, lost_hits=readout.lost_hits + lost)


class Detector(Protocol):
    """Interface of every source of pixel hits: the camera itself, a recording in real time, or the simulation's feed."""

    def readouts(self) -> AsyncIterator[Readout]:
        """Yield readouts as they arrive, while the detector is open. A lost link is reopened, and reported in ``problems``."""

    @property
    def problems(self) -> tuple[str, ...]:
        """Present problems of the detector, one line each."""

    async def close(self) -> None:
        """Release the device or link, so that ``readouts`` ends."""
