"""Records as others may write them: no size that a file states or compresses takes memory or time, and none is silent."""

import stat
import struct
import time
import tracemalloc
import zlib

import lz4.frame
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk

from radron.agent.errors import FlightRecordError
from radron.agent.flight import mcapfile, topics
from radron.agent.flight.reader import RecordedFlight
from radron.agent.flight.recorded import RecordedPilot
from radron.agent.flight.recorder import FlightRecorder
from support.flights.recorded_flights import HEADER, telemetry

MAGIC = b"\x89MCAP0\r\n"
FOOTER = struct.pack("<BQQQI", Opcode.FOOTER, 20, 0, 0, 0) + MAGIC
BOMB_BYTES = 300_000_000


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A record of some steps on the ground, in one file."""
    folder = tmp_path_factory.mktemp("flight")
    recorder = FlightRecorder(folder, 100, HEADER)
    pilot = RecordedPilot(HEADER.pilot(folder), recorder)
    for count in range(200):
        now_ns = HEADER.started_ns + count * 50_000_000
        pilot.observe_vehicle(telemetry(now_ns))
        pilot.step(now_ns)
    recorder.close()
    return next(folder.glob("*.mcap"))


def chunk(compression, data, size, crc=0):
    builder = RecordBuilder()
    Chunk(compression, data, 0, 0, crc, size).write(builder)
    return builder.end()


def record(opcode, content):
    return struct.pack("<BQ", opcode, len(content)) + content


def beginning(whole):
    """Of a file: up to the first chunk."""
    data, place = whole.read_bytes(), len(MAGIC)
    while data[place] != Opcode.CHUNK:
        place += 9 + struct.unpack_from("<Q", data, place + 1)[0]
    return data[:place]


def read(tmp_path, content):
    """The records read from a file, and its flaw; in seconds, and a fraction of the memory that the file would take."""
    file = tmp_path / "d1-0000.mcap"
    file.write_bytes(content)
    tracemalloc.start()
    began_s = time.monotonic()
    flight = RecordedFlight(file, whole=False)
    count = sum(1 for _ in flight.records())
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert time.monotonic() - began_s < 5.0  # hundredths of a second, on a busy machine
    assert peak < BOMB_BYTES / 2
    return count, flight.flaw


UNSTATED = zstandard.ZstdCompressor(write_content_size=False)
PACKINGS = {
    "zstd": lambda zeros: ("zstd", zstandard.compress(zeros)),
    "zstd, of unknown size": lambda zeros: ("zstd", UNSTATED.compress(zeros)),
    "lz4": lambda zeros: ("lz4", lz4.frame.compress(zeros)),
}


@pytest.mark.parametrize("stated", [BOMB_BYTES, 1000, 0])
@pytest.mark.parametrize("packing", PACKINGS)
def test_a_chunk_that_unpacks_to_gigabytes_is_damage(whole, tmp_path, packing, stated):
    compression, packed = PACKINGS[packing](bytes(BOMB_BYTES))
    assert len(packed) < 2_000_000
    count, flaw = read(tmp_path, beginning(whole) + chunk(compression, packed, stated) + FOOTER)
    assert (count, flaw is not None) == (0, True)
    assert "bytes" in flaw


def test_chunks_of_each_packing_are_read(whole, tmp_path):
    data = record(Opcode.CHANNEL, struct.pack("<HHI", 1, 0, len(topics.WARN)) + topics.WARN.encode() + struct.pack("<II", 0, 0))
    data += record(Opcode.MESSAGE, struct.pack("<HIQQ", 1, 0, 5, 5) + b"[]")
    for packed in (chunk("zstd", zstandard.compress(data), len(data), zlib.crc32(data)), chunk("", data, len(data)),
                   chunk("lz4", lz4.frame.compress(data), len(data))):  # fmt: skip
        assert read(tmp_path, beginning(whole) + packed + FOOTER) == (1, None)
    damaged = chunk("zstd", zstandard.compress(data), len(data), zlib.crc32(data) ^ 1)
    assert "whose checksum is wrong" in read(tmp_path, beginning(whole) + damaged + FOOTER)[1]
    assert "packed by 'gzip'" in read(tmp_path, beginning(whole) + chunk("gzip", data, len(data)) + FOOTER)[1]


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (bytes(100_000_000), "zeros in the place of a record"),
        (record(Opcode.MESSAGE, b""), "a message of 0 bytes"),
        (chunk("", record(Opcode.MESSAGE, b""), 9), "a message of 0 bytes"),
        (chunk("", bytes(50_000_000), 50_000_000), "zeros in the place of a record"),
        (record(Opcode.CHUNK, b""), "EndOfFile"),
        (struct.pack("<BQ", Opcode.ATTACHMENT, 1 << 63), f"a record of {1 << 63} bytes; at most"),
    ],
)
def test_records_of_length_zero_and_of_any_length_are_damage(whole, tmp_path, content, says):
    count, flaw = read(tmp_path, beginning(whole) + content + FOOTER)
    assert count == 0
    assert says in flaw


def test_an_empty_file_is_said_to_be_empty(tmp_path):
    (tmp_path / "d1-0000.mcap").touch()
    with pytest.raises(FlightRecordError, match=r"d1-0000\.mcap: not a recorded flight: it is empty$"):
        RecordedFlight(tmp_path)
    (tmp_path / "d1-0000.mcap").write_bytes(b"x" * 100)
    with pytest.raises(FlightRecordError, match="not a recorded flight: ValueError: it does not begin as an MCAP file"):
        RecordedFlight(tmp_path)


def test_a_record_that_was_cut_off_lacks_its_end(whole, tmp_path):
    half = tmp_path / whole.name
    half.write_bytes(whole.read_bytes()[:-1000])
    flight = RecordedFlight(half, whole=False)
    assert sum(1 for _ in flight.records()) > 0
    (lack,) = flight.incomplete
    assert lack == (
        f"{whole.name}: the records end without a proper end: the process was killed, or is still writing; the end may be missing"
    )
    complete = RecordedFlight(whole)
    assert sum(1 for _ in complete.records()) > 0
    assert complete.incomplete == ()


def test_records_are_their_owners_alone(whole):
    """Records hold the key from which the nonces of commands follow."""
    assert stat.S_IMODE(whole.stat().st_mode) == 0o600


def test_the_limits_hold_what_the_recorder_writes():
    from radron.agent.flight.recorder import MOST_WAITING_BYTES, SEGMENT_BYTES  # noqa: PLC0415

    assert MOST_WAITING_BYTES < mcapfile.MAX_CHUNK_BYTES
    assert SEGMENT_BYTES <= mcapfile.MAX_RECORD_BYTES
