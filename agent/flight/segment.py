"""One MCAP file of a flight. A flight is divided into segments, so that old segments can be removed during the flight."""

from __future__ import annotations

import os
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

import msgspec
from mcap.writer import CompressionType, Writer

from radron.agent.flight.header import FlightHeader
from radron.agent.flight.topics import ENCODINGS

HEADER = "radron"  # name of the metadata record that every segment begins with
OWNER_ONLY = 0o600  # the header holds the key of this boot's nonces
CHUNK_BYTES = 256_000  # half a second is mostly less, and is flushed then
CALIBRATION_TYPE = "text/plain"  # of the attachments


def segment_path(folder: Path, header: FlightHeader, number: int) -> Path:
    """Return the path of one of a flight's files: names sort by time; names of one flight share its boot id."""
    began = datetime.fromtimestamp(header.started_ns // 1_000_000_000, UTC)
    return folder / f"{header.drone.id}-{began:%Y%m%dT%H%M%SZ}-{header.boot}-{number:04d}.mcap"


class Segment:
    """Writes one file of a flight's record (MCAP) in compressed chunks; records are on disk, and readable, from the next
    ``flush`` on.

    A flight is divided into such files, so that old ones can be removed during the flight. Raises OSError of the disk.
    """

    def __init__(self, path: Path, header: FlightHeader, number: int) -> None:
        self.path = path
        self._file = os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, OWNER_ONLY), "wb")
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._channels: dict[str, int] = {}
        try:
            self._begin(header, number)
        except OSError:
            with suppress(OSError):  # closing writes the buffer
                self._file.close()
            path.unlink(missing_ok=True)
            raise

    def _begin(self, header: FlightHeader, number: int) -> None:
        self._writer.start(profile="radron", library="radron")
        self._schema = self._writer.register_schema("object", "jsonschema", b'{"type":"object"}')
        about = msgspec.structs.replace(header, calibration={})
        self._writer.add_metadata(HEADER, {"header": msgspec.json.encode(about).decode(), "segment": str(number)})
        for name, text in header.calibration.items():
            self._writer.add_attachment(header.started_ns, header.started_ns, name, CALIBRATION_TYPE, text.encode())
        self.flush()

    @property
    def size_bytes(self) -> int:
        """Size (bytes) of the flight record's file so far."""
        return self._file.tell()

    @property
    def is_there(self) -> bool:
        """Whether the flight record's file is still in its place: records in a removed file are lost."""
        try:
            return self.path.stat().st_ino == os.fstat(self._file.fileno()).st_ino
        except FileNotFoundError:
            return False

    def write(self, topic: str, data: bytes, log_ns: int, publish_ns: int, sequence: int) -> None:
        """Append a record to the file of the flight record."""
        channel = self._channels.get(topic)
        if channel is None:
            encoding = ENCODINGS.get(topic, "json")
            channel = self._writer.register_channel(topic, encoding, self._schema if encoding == "json" else 0)
            self._channels[topic] = channel
        self._writer.add_message(channel, log_ns, data, publish_ns, sequence)

    def flush(self) -> None:
        """Hand all records to the operating system, so that they survive the end of this process."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def sync(self) -> None:
        """Wait until all records of the flight are on the disk, so that they survive a power failure."""
        os.fdatasync(self._file.fileno())

    def close(self) -> None:
        """Write the index and close the file of the flight record; the file is closed even if that fails."""
        try:
            self._writer.finish()  # type: ignore[no-untyped-call]
        finally:
            self._file.close()


def prune(folder: Path, limit_bytes: int, keep: Path) -> None:
    """Remove the oldest files, of whatever flight, until all files together are below the limit; ``keep`` is never removed."""
    found = []
    for path in folder.glob("*.mcap"):
        try:
            about = path.stat()
        except OSError:  # removed by another agent meanwhile
            continue
        found.append((about.st_mtime_ns, path, about.st_size))
    excess = sum(size for _, _, size in found) - limit_bytes
    for _, path, size in sorted(found):
        if excess <= 0:
            return
        if path != keep:
            path.unlink(missing_ok=True)
            excess -= size
