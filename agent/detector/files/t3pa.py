"""Reader of the real camera's files, Advacam's ``.t3pa`` and ``.t3p``, in pieces, so that memory does not grow with the file.

Text with a header row that names the columns (Index, Matrix Index, ToA, ToT, FToA, Overflow). Time in ns is 25 ToA - (25/16)
FToA; FToA has 5 bits. Rows with Overflow = 1 are no hits. Matrix index 0x74 marks the start of lost data, 0x75 its end, with the
length of the missing time as its ToA. A file may hold several measurements, one appended to the other: Index begins anew with
each (Advacam's description of its file types).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from radron.agent.detector.delivery import LOST_END, Delivery, Gathering
from radron.agent.detector.files.binary import binary_tables, is_binary
from radron.agent.detector.files.table import CHIP_PIXELS, INDEX, NO_INDEX, OVERFLOW, TOA, Layout, find_layout, parse_rows
from radron.agent.detector.files.toa import MAX_DISORDER_NS, PERIOD_BITS, BorderRepair, Unwrapper, wraps_in_chip
from radron.agent.detector.readout import PixelHits, Readout
from radron.agent.errors import DetectorError
from radron.agent.inputs import refuse_stream

MAX_UNNUMBERED_ROWS = 5_000_000  # of a file without Index, which is held in memory to be sorted
_PIECE_BYTES = 1 << 22
_HEADER_BYTES = 1024
_TORN = "ends in the middle of a row, which was left out (an interrupted measurement?)"
_MIN_FIRST_BYTES = 1 << 16  # rows among which a counter of 14 bits shows itself by its wraps
_PAUSE_TICKS = 16 * 400  # 10 us between two appended measurements, so that no event joins hits of both

Table = NDArray[np.int64]


class T3paReader:
    """Reads a file of the real camera (Advacam's ``.t3pa`` or ``.t3p``) piece by piece, so that memory does not grow with the
    file.

    ``position_bytes`` of ``size_bytes`` and ``rows`` (of hits and of lost data) show the progress.

    Appended measurements are read one after the other, with a pause of 10 us between them; ``measurements`` counts them, and
    ``measurement`` (from 1) chooses a single one. ``notes`` names missing parts of the file: columns, or the end of its last row,
    which is ignored then.

    The time of arrival (ToA) in the file may be extended, or may wrap when its counter is full. With ``toa_bits`` None a wrap is
    recognised: of 30 bits (every 26.8 s, a gap that only the weakest sources leave empty) by a step back of more than half of the
    range; of 14 bits (every 0.41 ms) if the first rows wrap several times and never exceed them. Events stay whole with 14 bits,
    but every pause longer than half of the range loses whole periods. Rates from such a file are too high: export with the
    extended ToA instead.
    """

    def __init__(
        self,
        path: Path,
        toa_bits: int | None = None,
        piece_bytes: int | None = None,
        *,
        measurement: int | None = None,
        chip: int | None = None,
    ) -> None:
        """Open the file and read its header.

        Args:
            path: the file.
            toa_bits: width of the counter in the file; None: recognised.
            piece_bytes: size of a piece; parsing one holds the interpreter lock, about 14 ms per MB.
            measurement: which of the appended measurements, from 1; None: all.
            chip: which of a detector's chips, from 0; None: the detector has one.

        Raises:
            DetectorError: the file cannot be opened.
        """
        self.path = path
        self._piece_bytes = piece_bytes or _PIECE_BYTES
        self._toa_bits = toa_bits
        self._chosen, self._chip = measurement, chip
        self.rows = self.measurements = 0
        self.notes: tuple[str, ...] = ()
        self.position_bytes = 0
        self._first_index = NO_INDEX
        self._last_index = NO_INDEX
        self._unwrap: Unwrapper | None = None
        self._repair = BorderRepair()
        self._offset: int | None = 0  # ticks added to a measurement; None: until its first hit is known
        self._latest = 0
        refuse_stream(path)
        try:
            self.size_bytes = path.stat().st_size
            with path.open("rb"):
                pass
        except OSError as error:
            raise DetectorError(f"{path}: cannot be read: {error.strerror}") from None

    def __iter__(self) -> Iterator[Delivery]:
        """Yield the hits of the file piece by piece. Raises DetectorError with the number of the first line that is not a valid
        row.
        """
        tables = self._tables()
        for table, numbers in tables:
            for start, end in self._measurements(table):
                if self._chosen in (None, self.measurements):
                    self.rows += end - start
                    yield self._piece(table[start:end], numbers[start:end])
        if self._chosen is not None and self._chosen > self.measurements:
            held = f"{self.measurements} measurement{'s' if self.measurements != 1 else ''}"
            raise DetectorError(f"{self.path}: holds {held}, no measurement {self._chosen}")

    def _tables(self) -> Iterator[tuple[Table, Table]]:
        """The rows with their line numbers, in pieces; of a file without Index all at once, in order of time."""
        with self.path.open("rb") as file:
            if is_binary(file.read(_HEADER_BYTES)):
                file.seek(0)
                yield from self._records(file)
                return
            file.seek(0)
            header = file.readline(_HEADER_BYTES)
            lines = file.readlines(max(self._piece_bytes, _MIN_FIRST_BYTES))
            layout = find_layout(self.path, header, next((text for text in lines if text.strip()), b""))
            self.notes = layout.notes
            pieces = self._parsed(file, layout, lines)
            yield from pieces if layout.numbered else self._sorted(pieces)

    def _parsed(self, file: BinaryIO, layout: Layout, lines: list[bytes]) -> Iterator[tuple[Table, Table]]:
        line = 2
        while lines:
            if not lines[-1].endswith(b"\n") and lines[-1].strip() and not layout.is_row(lines[-1]):
                self.notes += (_TORN,)
                lines.pop()
            table, numbers = parse_rows(self.path, layout, lines, line)
            self.position_bytes = file.tell()
            yield self._of_chip(table, numbers)
            line += len(lines)
            lines = file.readlines(self._piece_bytes)

    def _records(self, file: BinaryIO) -> Iterator[tuple[Table, Table]]:
        for table, numbers, torn in binary_tables(self.path, file):
            self.notes = (_TORN,) if torn else ()
            self.position_bytes = file.tell()
            yield self._of_chip(table, numbers)

    def _of_chip(self, table: Table, numbers: Table) -> tuple[Table, Table]:
        """The rows of the chosen chip, with matrix indices of that chip."""
        chips = table[:, 1] // CHIP_PIXELS
        if self._chip is None:
            if chips.any():
                raise DetectorError(
                    f"{self.path}: line {numbers[(chips > 0).argmax()]}: the matrix index is not in 0 .. 65535: a detector of "
                    "several chips; choose one with --chip"
                )
            return table, numbers
        chosen = chips == self._chip
        table, numbers = table[chosen], numbers[chosen]
        table[:, 1] -= self._chip * CHIP_PIXELS
        return table, numbers

    def _sorted(self, pieces: Iterator[tuple[Table, Table]]) -> Iterator[tuple[Table, Table]]:
        """All rows in order of time. Without Index the order of measurement is not known."""
        parts: list[tuple[Table, Table]] = []
        count = 0
        for part in pieces:
            parts.append(part)
            count += len(part[0])
            if count > MAX_UNNUMBERED_ROWS:
                raise DetectorError(
                    f"{self.path}: more than {MAX_UNNUMBERED_ROWS:,} rows without a column Index; export the measurement with it"
                )
        if parts:
            table, numbers = (np.concatenate(columns) for columns in zip(*parts, strict=True))
            order = np.argsort(table[:, TOA], kind="stable")
            yield table[order], numbers[order]

    def _measurements(self, table: Table) -> Iterator[tuple[int, int]]:
        """First and last row (excluded) of each measurement in a table; ``measurements`` and the clock continue with them."""
        if not len(table):
            return
        index = table[:, INDEX]
        if self._unwrap is None:
            self._first_index = int(index[0])
        before = np.concatenate(([self._last_index], index[:-1]))
        starts = np.flatnonzero((index == self._first_index) & (before > self._first_index)).tolist()
        self._last_index = int(index[-1])
        for start, end in pairwise((0, *starts, len(table))):
            if start == end:
                continue
            if self._unwrap is None or start in starts:
                self._begin(table[start:end, TOA])
            yield start, end

    def _begin(self, toa: Table) -> None:
        bits = self._toa_bits or (PERIOD_BITS if wraps_in_chip(toa) else None)
        self._unwrap = Unwrapper(self.path, bits)
        self._repair = BorderRepair()
        self.measurements += 1
        self._offset = 0 if self.measurements == 1 or self._chosen is not None else None

    def _piece(self, table: Table, numbers: Table) -> Delivery:
        hit = table[:, OVERFLOW] == 0
        lost = table[~hit]
        lost_ns = 25 * int(lost[lost[:, 1] == LOST_END, TOA].sum())
        _, index, toa, tot, ftoa, _ = table[hit].T
        assert self._unwrap is not None
        toa, repaired = self._unwrap.unwrapped(toa, numbers[hit]), self._repair.repaired
        if self._unwrap.extended:
            toa = self._repair.joined(toa)
        repaired = self._repair.repaired - repaired
        tick = 16 * toa - ftoa
        if len(tick):
            if self._offset is None:
                self._offset = self._latest + _PAUSE_TICKS - int(tick.min())
            tick += self._offset
            self._latest = max(self._latest, int(tick.max()))
        hits = PixelHits(tick, index.astype(np.uint16), tot.astype(np.uint16))
        return Delivery(hits, len(lost), lost_ns, repaired)


def readouts(reader: T3paReader, clock_ns: int = 0) -> Iterator[Readout]:
    """Yield the hits of a file as contiguous readouts (pixel hits of one interval), from the first hit on.

    clock_ns: time of tick 0; the detector's clock may have run for long before the measurement began. A readout ends 1 ms
    before the latest hit read so far, because later rows may still contain hits of this last millisecond.
    """
    gathering = Gathering()
    start_ns: int | None = None
    for piece in reader:
        gathering.add(piece)
        if gathering.first_tick is None or gathering.latest_tick is None or not len(piece.hits):
            continue
        if start_ns is None:
            start_ns = clock_ns + gathering.first_tick * 25 // 16
        end_ns = max(clock_ns + gathering.latest_tick * 25 // 16 - MAX_DISORDER_NS, start_ns)
        yield gathering.readout(start_ns, end_ns, clock_ns)
        start_ns = end_ns
    if start_ns is not None and gathering.latest_tick is not None:
        end_ns = max(clock_ns + gathering.latest_tick * 25 // 16 + 1, start_ns)
        yield gathering.readout(start_ns, end_ns, clock_ns)
