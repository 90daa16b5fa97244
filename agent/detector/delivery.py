"""Deliveries of a camera or its file, gathered into readouts: hits, lost data and missing time, each with one owner."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from radron.agent.detector.readout import PixelHits, Readout

LOST_END = 0x75  # matrix index of an overflow row whose ToA is the length of the missing time, 25 ns steps


class Delivery(Struct, frozen=True):
    """Hits as the camera or its file delivered them at once, with lost and repaired data.

    ``lost_hits``: rows that report lost data instead of a hit. ``lost_ns``: the missing time that they report. ``repaired_hits``:
    hits that the reader moved to the neighbouring period of the chip's counter.
    """

    hits: PixelHits
    lost_hits: int = 0
    lost_ns: int = 0
    repaired_hits: int = 0


class Gathering:
    """Collects the camera's deliveries until they become a readout (pixel hits of one interval). Reported missing time is dead
    time of the next readouts.

    ``first_tick``, ``latest_tick``: first and latest time of arrival of all hits so far; None before the first hit.
    """

    def __init__(self) -> None:
        self.first_tick: int | None = None
        self.latest_tick: int | None = None
        self._hits: list[PixelHits] = []
        self._lost_hits = self._lost_ns = self._repaired_hits = 0

    def __bool__(self) -> bool:
        """Return whether there are hits that are not in a readout yet."""
        return bool(self._hits)

    def add(self, delivery: Delivery, offset: int = 0) -> None:
        """Add the hits and losses of a delivery; ``offset``: ticks added to the times of its hits."""
        self._lost_hits += delivery.lost_hits
        self._lost_ns += delivery.lost_ns
        self._repaired_hits += delivery.repaired_hits
        hits = delivery.hits
        if len(hits):
            hits = replace(hits, tick=hits.tick + offset) if offset else hits
            first, latest = int(hits.tick.min()), int(hits.tick.max())
            self.first_tick = first if self.first_tick is None else self.first_tick
            self.latest_tick = latest if self.latest_tick is None else max(latest, self.latest_tick)
            self._hits.append(hits)

    def readout(self, start_ns: int, end_ns: int, clock_ns: int, *, later_hits: bool = True) -> Readout:
        """Return all collected data as the readout of an interval (ns), and start collecting the next one.

        clock_ns: time of tick 0. later_hits: whether hits after the interval's end are included; if not, they wait for the next
        readout.
        """
        hits = self._hits[0] if len(self._hits) == 1 else PixelHits.joined(self._hits)
        self._hits = []
        if not later_hits:
            now = hits.tick < ((end_ns - clock_ns) * 16 + 24) // 25
            if not np.all(now):
                self._hits, hits = [hits.take(~now)], hits.take(now)
        dead_ns = min(self._lost_ns, end_ns - start_ns)
        live_s = (end_ns - start_ns - dead_ns) * 1e-9
        found = Readout(start_ns, end_ns, clock_ns, live_s, hits, self._lost_hits, self._repaired_hits)
        self._lost_hits, self._lost_ns, self._repaired_hits = 0, self._lost_ns - dead_ns, 0
        return found
