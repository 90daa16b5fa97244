"""A camera's acquisitions, filled by its threads, turned into readouts by the event loop."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from radron.agent.detector.delivery import LOST_END, Delivery, Gathering
from radron.agent.detector.files.toa import MAX_DISORDER_NS, BorderRepair
from radron.agent.detector.readout import PixelHits, Readout

DELIVERY_NS = 500_000_000  # time within which a hit is expected to be delivered; later ones count in a later readout


@dataclass(slots=True)
class Acquisition:
    """One measurement of the camera, of at most ``length_ns``, requested at ``called_ns``, with the data delivered so far.

    The camera's threads set ``started_ns`` and append blocks, then set ``ended_ns``; the event loop takes the blocks. All times
    are own time.
    """

    called_ns: int
    length_ns: int
    started_ns: int | None = None
    ended_ns: int | None = None
    blocks: deque[Delivery] = field(default_factory=deque)
    repair: BorderRepair = field(default_factory=BorderRepair)


class AcquisitionReader:
    """Turns the data of a camera's measurements into readouts (pixel hits of one interval); time stamps count from the start of
    the first measurement.
    """

    def __init__(self) -> None:
        self._clock_ns: int | None = None
        self._current: Acquisition | None = None
        self._start_ns = 0
        self._gathering = Gathering()

    def read(self, acquisitions: deque[Acquisition], now_ns: int) -> list[Readout]:
        """Return the readouts that are available now; measurements that have ended and are read completely are removed from the
        queue.
        """
        readouts = []
        while acquisitions:
            acquisition = acquisitions[0]
            ended_ns = acquisition.ended_ns  # before the blocks, so that all blocks before the end are included
            if acquisition.started_ns is not None:
                readout = self._readout(acquisition, acquisition.started_ns, ended_ns, now_ns)
                if readout is not None:
                    readouts.append(readout)
            if ended_ns is None:
                break
            acquisitions.popleft()
        return readouts

    def _readout(self, acquisition: Acquisition, started_ns: int, ended_ns: int | None, now_ns: int) -> Readout | None:
        if self._clock_ns is None:
            self._clock_ns = started_ns
        if acquisition is not self._current:
            self._current, self._start_ns, self._gathering = acquisition, max(started_ns, self._start_ns), Gathering()
        blocks = [acquisition.blocks.popleft() for _ in range(len(acquisition.blocks))]
        for block in blocks:
            self._gathering.add(block, round((started_ns - self._clock_ns) * 16 / 25))
        latest = self._gathering.latest_tick
        latest_ns = 0 if latest is None else self._clock_ns + latest * 25 // 16
        end_ns = max(latest_ns - MAX_DISORDER_NS, now_ns - DELIVERY_NS)
        if ended_ns is not None:
            end_ns = min(ended_ns, started_ns + acquisition.length_ns)
        start_ns, end_ns = self._start_ns, max(min(end_ns, now_ns), self._start_ns)
        if end_ns == start_ns and not blocks:
            return None
        self._start_ns = end_ns
        return self._gathering.readout(start_ns, end_ns, self._clock_ns)


def block_of(columns: list[NDArray[np.int64]], repair: BorderRepair) -> Delivery:
    """Convert a block of pixel data from the vendor's software (``rawPixels``) to hits and losses.

    columns: matrix index, ToA, overflow, FToA and ToT, (N,) each for N rows. repair: the measurement's repair of misplaced times.
    """
    index, toa, overflow, ftoa, tot = columns[:5]
    hit = (overflow == 0) & (index >= 0) & (index < 1 << 16)
    lost_ns = 25 * int(toa[(overflow != 0) & (index == LOST_END)].sum())
    repaired = repair.repaired
    tick = 16 * repair.joined(toa[hit]) - ftoa[hit]
    hits = PixelHits(tick, index[hit].astype(np.uint16), tot[hit].astype(np.uint16))
    return Delivery(hits, len(index) - int(np.count_nonzero(hit)), lost_ns, repair.repaired - repaired)
