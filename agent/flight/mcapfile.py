"""Records of one MCAP file in order, each within a limit of size. A foreign file can state any length, and compress gigabytes.

The framing is read here (https://mcap.dev/spec: opcode, length, content), the contents by the library. The library's own reader
unpacks chunks of any size, and reads on through a file's zeros.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import Any, BinaryIO

import lz4.frame
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Message, Metadata
from mcap.stream_reader import MAGIC_SIZE
from zstandard import ZstdDecompressor, ZstdError

MAX_RECORD_BYTES = 64_000_000  # of a record in the file; the recorder's segments have no more altogether
MAX_CHUNK_BYTES = 64_000_000  # of a chunk, unpacked; the recorder's have half a second of flight, 0.3 MB
MAGIC = b"\x89MCAP0\r\n"
McapItem = Attachment | Channel | Chunk | Message | Metadata
# MemoryError: on a small computer; the rest: of flipped bits, wherever they are
DAMAGE = (McapError, ZstdError, RuntimeError, struct.error, zlib.error, ValueError, KeyError, MemoryError, OverflowError)

_FRAME = struct.Struct("<BQ")  # opcode and length
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time; then its data
_READERS: dict[int, type[Any]] = {
    Opcode.CHUNK: Chunk,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
    Opcode.ATTACHMENT: Attachment,
}
_ZEROS = "zeros in the place of a record, as after a power cut"
RawMessage = tuple[int, int, memoryview, int, int]  # channel, sequence, data, log and publish time


class UnfinishedError(ValueError):
    """The file of a flight record ends before its footer, as after a killed process."""

    def __str__(self) -> str:
        return "the file ends too early"


def items(stream: BinaryIO) -> Iterator[McapItem]:
    """Yield those records of an MCAP file that the flight recorder uses, with compressed chunks as they are.

    Raises:
        UnfinishedError: the file has no end.
        One of DAMAGE: no MCAP file, or an impossible record.
    """
    if _exactly(stream, MAGIC_SIZE) != MAGIC:
        raise ValueError("it does not begin as an MCAP file")
    while True:
        opcode, length = _FRAME.unpack(_exactly(stream, _FRAME.size))
        if length > MAX_RECORD_BYTES:
            raise ValueError(f"a record of {length} bytes; at most {MAX_RECORD_BYTES} are read")
        content = _exactly(stream, length)
        if opcode == Opcode.FOOTER:
            return
        item = _item(opcode, content)
        if item is not None:
            yield item


def messages(chunk: Chunk, topics: dict[int, str]) -> Iterator[RawMessage]:
    """Yield the messages of a compressed chunk; names of its channels (topics) are added to ``topics``, by number.

    The library would make an object of each message, in ten times the time. Raises one of DAMAGE if the chunk cannot be unpacked,
    or has impossible content.
    """
    data = memoryview(_unpacked(chunk))
    place = 0
    while place < len(data):
        opcode, length = _FRAME.unpack_from(data, place)
        begin = place + _FRAME.size
        place = begin + length
        if place > len(data):
            raise ValueError("a record is longer than its chunk")
        if opcode == Opcode.MESSAGE:
            _check_message(length)
            channel, sequence, log_ns, publish_ns = _MESSAGE.unpack_from(data, begin)
            yield channel, sequence, data[begin + _MESSAGE.size : place], log_ns, publish_ns
        elif opcode == Opcode.CHANNEL:
            found = Channel.read(ReadDataStream(BytesIO(data[begin:place])))
            topics[found.id] = found.topic
        elif opcode == 0:
            raise ValueError(_ZEROS)


def _exactly(stream: BinaryIO, length: int) -> bytes:
    data = stream.read(length)
    if len(data) < length:
        raise UnfinishedError
    return data


def _item(opcode: int, content: bytes) -> McapItem | None:
    stream = ReadDataStream(BytesIO(content))
    if opcode == Opcode.MESSAGE:
        _check_message(len(content))
        message: Message = Message.read(stream, len(content))
        return message
    if opcode == 0:
        raise ValueError(_ZEROS)
    kind = _READERS.get(opcode)  # others are no concern of the flight recorder's
    item: McapItem | None = None if kind is None else kind.read(stream)
    return item


def _check_message(length: int) -> None:
    if length < _MESSAGE.size:
        raise ValueError(f"a message of {length} bytes; it has at least {_MESSAGE.size}")


def _unpacked(chunk: Chunk) -> bytes:
    size = chunk.uncompressed_size
    if size > MAX_CHUNK_BYTES:
        raise ValueError(f"a chunk of {size} bytes; at most {MAX_CHUNK_BYTES} are unpacked")
    if chunk.compression == "zstd":
        data = ZstdDecompressor(max_window_size=MAX_CHUNK_BYTES).stream_reader(chunk.data).read(size + 1)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
    elif chunk.compression == "":
        data = chunk.data
    else:
        raise ValueError(f"a chunk packed by {chunk.compression[:20]!r}; zstd and lz4 are known")
    if len(data) != size:
        raise ValueError(f"a chunk whose size is not the stated {size} bytes")
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("a chunk whose checksum is wrong")
    return data
