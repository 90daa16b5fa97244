"""Writes a flight's records to disk without ever delaying the flight loop."""

from __future__ import annotations

import errno
import time
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Event, Thread
from typing import NamedTuple

from radron.agent.errors import FlightRecordError
from radron.agent.flight.header import FlightHeader
from radron.agent.flight.segment import Segment, prune, segment_path
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

SEGMENT_BYTES = 64_000_000  # at most, and at most a quarter of the limit, so that old records are removed in small portions
MOST_WAITING_BYTES = 32_000_000  # minutes of flight; if the disk stalls for longer, records are lost
WRITE_S = 0.1  # small portions: the writing thread holds the interpreter lock for less than a millisecond
FLUSH_S = 0.5
SYNC_S = 5.0
RETRY_S = 10.0  # after a write error


class _Record(NamedTuple):
    topic: str
    data: bytes
    log_ns: int
    publish_ns: int
    sequence: int


class FlightRecorder:
    """Writes the records of one flight to disk, on a thread of its own, so that the flight loop never waits for the disk.

    Everything older than about ``FLUSH_S`` survives a kill of the process. Records are lost if the disk fails or is too slow: the
    losses are counted, ``problems`` reports them, and the gap shows in the records' sequence numbers.
    """

    def __init__(
        self, folder: str | Path, limit_mb: int, header: FlightHeader, clock_ns: Callable[[], int] = time.time_ns
    ) -> None:
        """Open the first file of the record.

        Args:
            folder: for the files; created if missing.
            limit_mb: of all files in the folder together; the oldest are removed first, files of this flight included.
            header: of the flight.
            clock_ns: wall time.

        Raises:
            FlightRecordError: the folder cannot be written to.
        """
        self._folder = Path(folder)
        self._limit_bytes = limit_mb * 1_000_000
        self._segment_bytes = min(SEGMENT_BYTES, self._limit_bytes // 4)
        self._header = header
        self._clock_ns = clock_ns
        self.counters: Counter[str] = Counter()
        self._waiting: deque[_Record] = deque()
        self._sequence = 0
        self._put_bytes = self._taken_bytes = 0  # each written by one thread only
        self._problem: str | None = None
        self._number = 0
        self._synced_s = self._flushed_s = self._refused_s = 0.0
        self._segment: Segment | None = None
        try:
            self._open_segment()
        except OSError as error:
            text = f"{self._folder}: flight records cannot be written: {error.strerror}; see recorder.folder in the drone file"
            raise FlightRecordError(text) from None
        self._closing = Event()
        self._thread = Thread(target=self._run, name="flight-recorder", daemon=True)
        self._thread.start()

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """Present problems of the flight recorder, one line each, such as a slow disk."""
        problem = self._problem
        if problem is None and self._is_full:
            problem = f"flight records are being lost: the disk is too slow ({self._folder})"
        return (CodedText(Code.RECORDS_LOST, problem),) if problem is not None else ()

    @property
    def _is_full(self) -> bool:
        return self._put_bytes - self._taken_bytes > MOST_WAITING_BYTES

    def write(self, topic: str, data: bytes, log_ns: int | None = None) -> None:
        """Queue a record of the flight for writing; ``log_ns``: its time, None: now. Never raises, never waits."""
        now_ns = self._clock_ns()
        record = _Record(topic, data, now_ns if log_ns is None else max(0, log_ns), now_ns, self._sequence)
        self._sequence += 1
        if self._is_full:
            self.counters["records_lost"] += 1
            return
        self._put_bytes += len(data)
        self._waiting.append(record)

    def close(self) -> None:
        """Write the queue and close the file; waits for the disk, but at most for a second."""
        self._closing.set()
        self._thread.join(timeout=1.0)

    def _run(self) -> None:
        while not self._closing.wait(WRITE_S):
            self._guarded(self._write_waiting)
        self._guarded(self._write_waiting)
        self._guarded(self._close_segment)

    def _guarded(self, work: Callable[[], None]) -> None:
        """Run a task; errors are reported as problems and never end the recording."""
        try:
            work()
        except Exception as error:
            reason = error.strerror if isinstance(error, OSError) else f"{type(error).__name__}: {error}"
            self._problem = f"flight records are being lost: {reason} ({self._folder})"
            self.counters["refusals"] += 1
            self._refused_s = time.monotonic()
            self._abandon_segment()

    def _write_waiting(self) -> None:
        now_s = time.monotonic()
        if self._segment is None and now_s - self._refused_s >= RETRY_S:
            self._open_segment()
            self._problem = None
        while self._waiting:
            record = self._waiting.popleft()
            self._taken_bytes += len(record.data)
            if self._segment is None:
                self.counters["records_lost"] += 1
            else:
                self._segment.write(*record)
        if self._segment is not None:
            self._keep_up(self._segment, now_s)

    def _keep_up(self, segment: Segment, now_s: float) -> None:
        if now_s - self._flushed_s >= FLUSH_S:
            self._flushed_s = now_s
            segment.flush()
            if not segment.is_there:
                raise OSError(errno.ENOENT, "the file has been removed")
        if now_s - self._synced_s >= SYNC_S:
            self._synced_s = now_s
            segment.sync()
        if segment.size_bytes >= self._segment_bytes:
            self._close_segment()
            self._open_segment()

    def _open_segment(self) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        number, self._number = self._number, self._number + 1
        path = segment_path(self._folder, self._header, number)
        self._segment = Segment(path, self._header, number)
        prune(self._folder, self._limit_bytes - self._segment_bytes, keep=path)

    def _close_segment(self) -> None:
        segment, self._segment = self._segment, None
        if segment is not None:
            segment.close()

    def _abandon_segment(self) -> None:
        segment, self._segment = self._segment, None
        if segment is not None:
            with suppress(Exception):  # the error for which it is abandoned, and what follows from it
                segment.close()
