"""Reader of the real camera's files, Advacam's ``.t3pa``, in pieces, so that memory does not grow with the file.

Tab-separated text with a header row that names the columns (Index, Matrix Index, ToA, ToT, FToA, Overflow); further columns, of
any content, are ignored. Time in ns is 25 ToA - (25/16) FToA; FToA has 5 bits. Rows with Overflow = 1 are no hits: matrix index
0x74 marks the start of lost data, 0x75 its end, with the length of the missing time as its ToA (Advacam's description of its file
types).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from agent.detector.readout import SENSOR_PIXELS, PixelHits, Readout
from agent.errors import DetectorError

REQUIRED = ("matrix index", "toa", "tot", "ftoa", "overflow")
LOST_END = 0x75  # matrix index of an overflow row whose ToA is the length of the missing time
_PIECE_BYTES = 1 << 22
DISORDER_NS = 1_000_000  # by which a hit may follow a later one: its time over threshold and the readout queue
_JUMP = 1 << 13  # 25 ns steps: a ToA further back than this is no mere disorder
_TOA_BITS = (14, 30)  # the chip's own counter, and that with the readout's extension
_SECONDS = 25e-9


@dataclass(frozen=True, slots=True)
class Piece:
    """Rows of a part of the file. ``overflow_rows`` are not in ``hits``; ``lost_ns`` is the missing time that they report."""

    hits: PixelHits
    overflow_rows: int
    lost_ns: int


class T3paReader:
    """Iterates over the pieces of a file; ``position_bytes`` of ``size_bytes`` and ``rows`` show the progress.

    ``torn``: the file ends in the middle of a row, as after an interrupted measurement; that row is ignored.

    ToA in the file may be extended, or may wrap. With ``toa_bits`` None a wrap is recognised: a ToA that falls back by more than
    half of a counter's range (14 or 30 bits) that no value before has exceeded. 30 bits wrap every 26.8 s, a gap that only the
    weakest sources leave empty. 14 bits wrap every 0.41 ms: events stay whole, but every pause longer than half of that loses
    whole periods, so that rates from such a file are too high; export with the extended ToA instead.
    """

    def __init__(self, path: Path, toa_bits: int | None = None, piece_bytes: int | None = None) -> None:
        """``piece_bytes``: size of a piece; parsing one holds the interpreter lock, about 14 ms per MB.

        Raises:
            DetectorError: the file cannot be opened.
        """
        self.path = path
        self._piece_bytes = piece_bytes or _PIECE_BYTES
        self._unwrap = _Unwrapper(path, toa_bits)
        self.rows = 0
        self.torn = False
        self.position_bytes = 0
        try:
            self.size_bytes = path.stat().st_size
            with path.open("rb"):
                pass
        except OSError as error:
            raise DetectorError(f"{path}: cannot be read: {error.strerror}") from None

    def __iter__(self) -> Iterator[Piece]:
        """Raises DetectorError with the number of the first line that is not a row of such a file."""
        with self.path.open("rb") as file:
            columns = self._header(file)
            line = 2
            while True:
                lines = file.readlines(self._piece_bytes)
                if not lines:
                    return
                if not lines[-1].endswith(b"\n") and not _is_row(lines[-1], columns):
                    self.torn = True
                    lines.pop()
                table = self._table(lines, columns, line)
                self.position_bytes = file.tell()
                self.rows += len(table)
                yield self._piece(table, line)
                line += len(lines)

    def _header(self, file: BinaryIO) -> list[int]:
        """Indices of the required columns."""
        first = file.readline(1024)
        names = [name.strip().lower() for name in first.decode("utf-8-sig", errors="replace").split("\t")]
        missing = [name for name in REQUIRED if name not in names]
        if missing:
            raise DetectorError(
                f"{self.path}: line 1: not the header of a .t3pa file (no column {missing[0]!r}); "
                "export the measurement as Timepix3 pixels, ASCII"
            )
        return [names.index(name) for name in REQUIRED]

    def _table(self, lines: list[bytes], columns: list[int], line: int) -> NDArray[np.int64]:
        """The required columns (N, 5), checked."""
        if not lines:
            return np.empty((0, len(REQUIRED)), np.int64)
        if not lines[0].strip():  # of empty lines alone loadtxt would warn on the terminal
            raise self._broken(lines, columns, line)
        try:
            table: NDArray[np.int64] = np.loadtxt(lines, np.int64, delimiter="\t", comments=None, ndmin=2, usecols=columns)
        except (ValueError, OverflowError):
            raise self._broken(lines, columns, line) from None
        if len(table) != len(lines):
            raise self._broken(lines, columns, line)
        index, toa, tot, ftoa, overflow = table.T
        rules = (
            ((index >= 0) & (index < SENSOR_PIXELS**2), "the matrix index is not in 0 .. 65535"),
            ((toa >= 0) & (toa < 1 << 56), "ToA is out of range"),
            ((tot >= 0) & (tot < 1 << 16), "ToT is out of range"),
            ((ftoa >= 0) & (ftoa < 32), "FToA is not in 0 .. 31"),
            ((overflow >= 0) & (overflow <= 1), "Overflow is not 0 or 1 (a detector of several chips?)"),
        )
        for good, problem in rules:
            if not good.all():
                raise DetectorError(f"{self.path}: line {line + int(good.argmin())}: {problem}")
        return table

    def _broken(self, lines: list[bytes], columns: list[int], line: int) -> DetectorError:
        """The error for the first of the lines that is not a row."""
        for number, text in enumerate(lines, start=line):
            if not _is_row(text, columns):
                shown = text[:60].decode("ascii", errors="replace").strip()
                return DetectorError(f"{self.path}: line {number}: not a row of whole numbers, as its header has them: {shown!r}")
        return DetectorError(f"{self.path}: lines {line} to {line + len(lines) - 1}: numbers that are too large")

    def _piece(self, table: NDArray[np.int64], line: int) -> Piece:
        index, toa, tot, ftoa, overflow = table.T
        hit = overflow == 0
        overflow_rows = len(table) - int(np.count_nonzero(hit))
        lost_ns = 0
        rows = np.arange(line, line + len(table))
        if overflow_rows:
            lost_ns = 25 * int(toa[~hit & (index == LOST_END)].sum())
            index, toa, tot, ftoa, rows = index[hit], toa[hit], tot[hit], ftoa[hit], rows[hit]
        tick = 16 * self._unwrap(toa, rows) - ftoa
        return Piece(PixelHits(tick, index.astype(np.uint16), tot.astype(np.uint16)), overflow_rows, lost_ns)


def _is_row(text: bytes, columns: list[int]) -> bool:
    """Whether a line has integers in these columns."""
    fields = text.strip(b"\r\n").split(b"\t")
    return max(columns) < len(fields) and all(fields[column].strip().lstrip(b"-").isdigit() for column in columns)


class _Unwrapper:
    """Extends a time of arrival that wraps."""

    def __init__(self, path: Path, bits: int | None) -> None:
        self._path = path
        self._modulus = None if bits is None else 1 << bits
        self._last: int | None = None  # the last value in the file
        self._highest = 0
        self._turns = 0

    def __call__(self, toa: NDArray[np.int64], line: NDArray[np.intp]) -> NDArray[np.int64]:
        """The extended values (N,) of the next rows."""
        if len(toa) == 0:
            return toa
        steps = np.diff(toa, prepend=toa[0] if self._last is None else self._last)
        if self._modulus is None:
            self._recognise(toa, steps, line)
        self._last = int(toa[-1])
        self._highest = max(self._highest, int(toa.max()))
        if self._modulus is None:
            return toa
        if self._highest >= self._modulus:
            bits = self._modulus.bit_length() - 1
            raise DetectorError(f"{self._path}: line {line[toa.argmax()]}: ToA does not fit a counter of {bits} bits")
        turns = self._turns + np.cumsum((steps < -self._modulus // 2).astype(np.int64) - (steps > self._modulus // 2))
        self._turns = int(turns[-1])
        continued: NDArray[np.int64] = toa + turns * self._modulus
        return continued

    def _recognise(self, toa: NDArray[np.int64], steps: NDArray[np.int64], line: NDArray[np.intp]) -> None:
        """Take the first large step back for a wrap of the smallest counter that it fits."""
        back = int((steps < -_JUMP).argmax())
        step = -int(steps[back])
        if step <= _JUMP:
            return
        highest = max(self._highest, int(toa[: back + 1].max()), int(toa[back]) + step)
        for bits in _TOA_BITS:
            if highest < 1 << bits and step > 1 << (bits - 1):
                self._modulus = 1 << bits
                return
        if step * 25 > 100 * DISORDER_NS:
            raise DetectorError(
                f"{self._path}: line {line[back]}: ToA falls back by {step * _SECONDS:.3g} s, which is no wrap of its counter; "
                "a file must hold one measurement"
            )


def readouts(reader: T3paReader, clock_ns: int = 0) -> Iterator[Readout]:
    """The file as contiguous readouts from its first hit on; ``clock_ns`` is the UTC time of tick 0.

    The detector's clock may have run for long before the measurement began. A readout ends 1 ms before the latest hit read so
    far, because later rows may still contain hits of that time.
    """
    start_ns: int | None = None
    latest = lost_ns = overflow_rows = 0
    for piece in reader:
        lost_ns += piece.lost_ns
        overflow_rows += piece.overflow_rows
        if not len(piece.hits):
            continue
        if start_ns is None:
            start_ns = clock_ns + int(piece.hits.tick.min()) * 25 // 16
        latest = max(latest, int(piece.hits.tick.max()) * 25 // 16)
        end_ns = max(clock_ns + latest - DISORDER_NS, start_ns)
        dead_ns = min(lost_ns, end_ns - start_ns)
        lost_ns -= dead_ns
        yield Readout(start_ns, end_ns, clock_ns, (end_ns - start_ns - dead_ns) * 1e-9, piece.hits, overflow_rows)
        start_ns, overflow_rows = end_ns, 0
    if start_ns is not None:
        end_ns = max(clock_ns + latest + 1, start_ns)
        live_ns = max(end_ns - start_ns - lost_ns, 0)
        yield Readout(start_ns, end_ns, clock_ns, live_ns * 1e-9, PixelHits.none(), overflow_rows)
