"""Playback of a recording of the real camera (.t3pa) in real time."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path

from agent.detector.files.t3pa import Piece, T3paReader
from agent.detector.files.toa import MAX_DISORDER_NS
from agent.detector.readout import PixelHits, Readout
from agent.errors import DetectorError

SLICE_NS = 200_000_000
_PIECE_BYTES = 1 << 16  # parsing holds the interpreter lock: 1 ms per piece


class RecordedDetector:
    """Plays ``path`` from its first hit on, in slices of 0.2 s stamped with the present time, until the end of the file, which it
    reports.
    """

    def __init__(self, path: Path, clock_ns: Callable[[], int] = time.time_ns) -> None:
        """Raises DetectorError where the file cannot be read or does not begin like a .t3pa file."""
        self._path = path
        self._clock_ns = clock_ns
        self._problem: str | None = None
        self._closed = asyncio.Event()
        next(iter(T3paReader(path, piece_bytes=_PIECE_BYTES)), None)

    @property
    def problems(self) -> tuple[str, ...]:
        """Present problems, one line each."""
        return () if self._problem is None else (self._problem,)

    async def readouts(self) -> AsyncIterator[Readout]:
        """Slices at their time, until the file ends or ``close``."""
        slices = playback(T3paReader(self._path, piece_bytes=_PIECE_BYTES), self._clock_ns())
        while True:
            try:
                readout = await asyncio.to_thread(next, slices, None)
            except DetectorError as error:
                self._problem = f"the recording cannot be read further: {error}"
                return
            if readout is None:
                self._problem = f"the recording {self._path} has ended"
                return
            if await self._wait_until(readout.end_ns):
                return
            yield readout

    async def _wait_until(self, stamp_ns: int) -> bool:
        """Sleep until the stamp; returns True where ``close`` came first."""
        try:
            async with asyncio.timeout((stamp_ns - self._clock_ns()) * 1e-9):
                await self._closed.wait()
        except TimeoutError:
            return self._closed.is_set()
        return True

    async def close(self) -> None:
        """Close the file; ``readouts`` ends."""
        self._closed.set()


def playback(reader: T3paReader, start_ns: int, slice_ns: int = SLICE_NS) -> Iterator[Readout]:
    """The file's hits as contiguous readouts of ``slice_ns``, the first hit at ``start_ns`` (UTC).

    Missing time that the file reports is subtracted from the live time of the slices that follow the report. Raises DetectorError
    with the line that is not a row of such a file.
    """
    pieces = iter(reader)
    clock_ns: int | None = None
    held = PixelHits.none()
    latest_ns, lost_ns, lost_hits, repaired = start_ns, 0, 0, 0
    piece: Piece | None = None
    while True:
        end_ns = start_ns + slice_ns
        while clock_ns is None or latest_ns - MAX_DISORDER_NS < end_ns:
            piece = next(pieces, None)
            if piece is None:
                break
            lost_ns += piece.lost_ns
            lost_hits += piece.overflow_rows
            repaired += piece.repaired
            if not len(piece.hits):
                continue
            if clock_ns is None:
                clock_ns = start_ns - int(piece.hits.tick.min()) * 25 // 16
            latest_ns = max(latest_ns, clock_ns + int(piece.hits.tick.max()) * 25 // 16)
            held = PixelHits.joined((held, piece.hits))
        if clock_ns is None or (piece is None and not len(held)):
            return
        now = held.tick < ((end_ns - clock_ns) * 16 + 24) // 25
        dead_ns = min(lost_ns, slice_ns)
        yield Readout(start_ns, end_ns, clock_ns, (slice_ns - dead_ns) * 1e-9, held.take(now), lost_hits, repaired)
        held = held.take(~now)
        lost_ns, lost_hits, repaired, start_ns = lost_ns - dead_ns, 0, 0, end_ns
