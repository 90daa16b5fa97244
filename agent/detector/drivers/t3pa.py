"""Playback of a recording of the real camera (.t3pa) in real time."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path

from radron.agent.detector.delivery import Gathering
from radron.agent.detector.files.t3pa import T3paReader
from radron.agent.detector.files.toa import MAX_DISORDER_NS
from radron.agent.detector.readout import Readout
from radron.agent.errors import DetectorError

SLICE_NS = 200_000_000
_PIECE_BYTES = 1 << 16  # parsing holds the interpreter lock: 1 ms per piece


class RecordedDetector:
    """Plays a recording of the real camera (``path``, .t3pa) in real time, as if the camera measured now.

    The hits come in readouts of 0.2 s with present time stamps, from the first hit to the end of the file, which is reported.
    """

    def __init__(self, path: Path, clock_ns: Callable[[], int] = time.time_ns) -> None:
        """Open the recording. Raises DetectorError if it cannot be read, or does not begin like a .t3pa file."""
        self._path = path
        self._clock_ns = clock_ns
        self._problem: str | None = None
        self._closed = asyncio.Event()
        next(iter(T3paReader(path, piece_bytes=_PIECE_BYTES)), None)

    @property
    def problems(self) -> tuple[str, ...]:
        """Present problems of the playback, one line each, such as the end of the recording."""
        return () if self._problem is None else (self._problem,)

    async def readouts(self) -> AsyncIterator[Readout]:
        """Yield the recording's pixel hits in real time, in readouts of 0.2 s, until the file ends or ``close`` is called."""
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
        """Stop the playback of the recording, so that ``readouts`` ends."""
        self._closed.set()


def playback(reader: T3paReader, start_ns: int, slice_ns: int = SLICE_NS) -> Iterator[Readout]:
    """Yield the hits of a file as contiguous readouts of ``slice_ns``, with the first hit at ``start_ns``.

    Missing time that the file reports is subtracted from the live time of the readouts (pixel hits of one interval) that follow
    the report. Raises DetectorError with the number of a line that is not a row of such a file.
    """
    pieces = iter(reader)
    gathering = Gathering()
    clock_ns: int | None = None
    latest_ns, ended = start_ns, False
    while True:
        end_ns = start_ns + slice_ns
        while not ended and (clock_ns is None or latest_ns - MAX_DISORDER_NS < end_ns):
            piece = next(pieces, None)
            ended = piece is None
            if piece is not None:
                gathering.add(piece)
            if gathering.first_tick is not None and gathering.latest_tick is not None:
                clock_ns = start_ns - gathering.first_tick * 25 // 16 if clock_ns is None else clock_ns
                latest_ns = clock_ns + gathering.latest_tick * 25 // 16
        if clock_ns is None or (ended and not gathering):
            return
        yield gathering.readout(start_ns, end_ns, clock_ns, later_hits=False)
        start_ns = end_ns
