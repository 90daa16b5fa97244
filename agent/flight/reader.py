"""Reader of recorded flights: the segments of one flight as one sequence of records, as far as they are intact."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec
from mcap.records import Attachment, Channel, Chunk, Message, Metadata

from radron.agent.errors import FlightRecordError
from radron.agent.flight.header import FlightHeader, Recording
from radron.agent.flight.mcapfile import DAMAGE, UnfinishedError, items, messages
from radron.agent.flight.segment import HEADER
from radron.agent.flight.topics import OUT
from radron.agent.inputs import refuse_stream

_Raw = tuple[int, str, memoryview, int, int]  # sequence, topic, data, log and publish time

UNFINISHED = "the records end without a proper end: the process was killed, or is still writing"
REMOVED = "its first file was removed to keep the folder within its limit"


class FlightRecord(NamedTuple):
    """One record of a flight. ``log_ns`` is the pilot's time, ``publish_ns`` wall time (see ``topics``)."""

    topic: str
    data: bytes
    log_ns: int
    publish_ns: int


class RecordedCall(NamedTuple):
    """A recorded call of the pilot program with its results; the results of the last call may have been cut off."""

    record: FlightRecord
    results: list[tuple[str, bytes]]
    is_last: bool


class RecordedFlight:
    """Reader of one recorded flight, which may consist of several files.

    ``header``: inputs from which the flight's pilot was made. After reading: ``flaw``: why it could not be read to its end, or
    None; ``truncated``: the last file has no proper end, as after a killed process; ``read_bytes``: how much of ``size_bytes``
    has been read. ``lacks_beginning``: its first records are missing.
    """

    def __init__(self, path: Path, whole: bool = True) -> None:
        """Open the files of a flight.

        ``path``: any file of a flight, or a folder with one flight; ``whole``: from its beginning, or not at all.

        Raises:
            FlightRecordError: no such file, not a recorded flight, a folder with several, or the beginning of the flight is
                missing.
            ConfigError: a pipe or a device.
        """
        self.files = _files(path)
        self.size_bytes = sum(file.stat().st_size for file in self.files)
        self.read_bytes = 0
        self.truncated = False
        self.flaw: str | None = None
        self.header = _header(self.files[0])
        first = next(iter(self.records()), None)
        self.lacks_beginning = self._first_sequence not in (None, 0) or (first is None and self.flaw is not None)
        if whole and self.lacks_beginning:
            reason = self.flaw or REMOVED
            raise FlightRecordError(
                f"{self.files[0]}: it cannot be replayed, as the beginning of the flight is missing: {reason}"
            )

    @property
    def incomplete(self) -> tuple[str, ...]:
        """Gaps of the records, as sentences about a file; known once the records have been read."""
        beginning = (f"{self.files[0].name}: the beginning is missing: {REMOVED}",) if self.lacks_beginning else ()
        end = (f"{self.files[-1].name}: {UNFINISHED}; the end may be missing",) if self.truncated and self.flaw is None else ()
        return (*beginning, *((self.flaw,) if self.flaw is not None else ()), *end)

    def records(self, topics: Collection[str] | None = None) -> Iterator[FlightRecord]:
        """Yield all records in order, or the records of some topics only, up to the end, a gap or damage."""
        self.read_bytes, self.truncated, self.flaw = 0, False, None
        self._first_sequence: int | None = None
        expected: int | None = None
        for file in self.files:
            before = self.read_bytes
            for sequence, topic, data, log_ns, publish_ns in self._messages(file, before):
                if expected is None:
                    self._first_sequence = sequence
                elif sequence != expected:
                    self.flaw = f"{sequence - expected} records are missing in {file.name}"
                    return
                expected = sequence + 1
                if topics is None or topic in topics:
                    yield FlightRecord(topic, bytes(data), log_ns, publish_ns)
            if self.flaw is not None:
                return
            self.read_bytes = before + file.stat().st_size

    def calls(self) -> Iterator[RecordedCall]:
        """Yield each recorded call of the pilot program with its results, in order."""
        call: FlightRecord | None = None
        results: list[tuple[str, bytes]] = []
        for record in self.records():
            if record.topic.startswith(OUT):
                results.append((record.topic, record.data))
                continue
            if call is not None:
                yield RecordedCall(call, results, False)
            call, results = record, []
        if call is not None:
            yield RecordedCall(call, results, True)

    def _messages(self, file: Path, before: int) -> Iterator[_Raw]:
        topics: dict[int, str] = {}
        self.truncated = False
        with file.open("rb") as stream:
            try:
                for item in items(stream):
                    self.read_bytes = before + stream.tell()
                    if isinstance(item, Chunk):
                        for channel, sequence, data, log_ns, publish_ns in messages(item, topics):
                            yield sequence, topics[channel], data, log_ns, publish_ns
                    elif isinstance(item, Channel):
                        topics[item.id] = item.topic
                    elif isinstance(item, Message):
                        yield item.sequence, topics[item.channel_id], memoryview(item.data), item.log_time, item.publish_time
            except UnfinishedError:
                self.truncated = True
            except DAMAGE as error:
                self.flaw = f"{file.name} is damaged: {_reason(error)}"


def _reason(error: Exception) -> str:
    return f"{type(error).__name__}: {error}".removesuffix(": ")


def _files(path: Path) -> list[Path]:
    """The segments of a flight in order."""
    if path.is_dir():
        found = sorted(path.glob("*.mcap"))
        flights = {_flight(file): file for file in reversed(found)}
        if len(flights) > 1:
            names = ", ".join(file.name for file in sorted(flights.values())[:10])
            raise FlightRecordError(f"{path}: holds {len(flights)} flights; name a file of one of them: {names}")
        if not found:
            raise FlightRecordError(f"{path}: holds no .mcap files")
        return found
    refuse_stream(path)
    if not path.is_file():
        raise FlightRecordError(f"{path}: no such file")
    return sorted({path, *(file for file in path.parent.glob("*.mcap") if _flight(file) == _flight(path))})


def _flight(file: Path) -> str:
    """The part of the name that a flight's segments share: everything but the segment's number."""
    name, _, number = file.stem.rpartition("-")
    return name if number.isdecimal() else file.stem


def _header(file: Path) -> FlightHeader:
    """The header at the beginning of a segment, with its attachments."""
    header: FlightHeader | None = None
    calibration = {}
    with file.open("rb") as stream:
        try:
            for item in items(stream):
                if isinstance(item, Metadata) and item.name == HEADER:
                    text = item.metadata["header"]
                    msgspec.json.decode(text, type=Recording).check_protocol(file)
                    header = msgspec.json.decode(text, type=FlightHeader)
                elif isinstance(item, Attachment):
                    calibration[item.name] = item.data.decode()
                elif isinstance(item, Chunk | Message):
                    break
        except msgspec.ValidationError as error:
            raise FlightRecordError(f"{file}: made by another version of radron: {error}") from None
        except DAMAGE as error:
            if header is None:
                reason = "it is empty" if file.stat().st_size == 0 else _reason(error)
                raise FlightRecordError(f"{file}: not a recorded flight: {reason}") from None
    if header is None:
        raise FlightRecordError(f"{file}: not a flight recorded by radron-agent")
    return msgspec.structs.replace(header, calibration=calibration)
