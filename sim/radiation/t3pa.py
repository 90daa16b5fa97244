"""Writer of Advacam's ``.t3pa``: tab-separated pixel hits with a header row; time in ns = 25 ToA - (25/16) FToA.

Independent of the agent's reader, constants included, so that neither can hide an error of the other.
"""

from __future__ import annotations

from typing import TextIO

import numpy as np

from radron.agent.detector.readout import Readout

HEADER = ("Index", "Matrix Index", "ToA", "ToT", "FToA", "Overflow")
LOST_START, LOST_END = 0x74, 0x75  # matrix indices of the rows that mark missing data


class T3paWriter:
    """Writes camera readouts to a text file in Advacam's format ``.t3pa``, in order.

    The time of arrival (ToA) is written extended: it does not wrap. A readout that lost hits is followed by two overflow rows:
    the start of the gap, and its end with the missing time as its ToA.
    """

    def __init__(self, file: TextIO) -> None:
        """Write the header row to the open file."""
        self._file = file
        self._row = 0
        file.write("\t".join(HEADER) + "\n")

    @property
    def rows(self) -> int:
        """Number of rows written so far."""
        return self._row

    def write(self, readout: Readout) -> None:
        """Append the pixel hits of a readout to the file."""
        hits = readout.hits
        count = len(hits)
        toa = -(-hits.tick // 16)
        table = np.empty((count, len(HEADER)), np.int64)
        table[:, 0] = np.arange(self._row, self._row + count)
        table[:, 1] = hits.index
        table[:, 2] = toa
        table[:, 3] = hits.tot
        table[:, 4] = 16 * toa - hits.tick
        table[:, 5] = 0
        np.savetxt(self._file, table, fmt="%d", delimiter="\t")
        self._row += count
        if readout.lost_hits:
            span_s = (readout.end_ns - readout.start_ns) * 1e-9
            start = (readout.start_ns - readout.clock_ns + round(1e9 * readout.live_time_s)) // 25
            self._overflow(LOST_START, start)
            self._overflow(LOST_END, round((span_s - readout.live_time_s) / 25e-9))

    def _overflow(self, index: int, toa: int) -> None:
        self._file.write(f"{self._row}\t{index}\t{toa}\t0\t0\t1\n")
        self._row += 1
