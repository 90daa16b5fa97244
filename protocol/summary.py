"""Summary of a drone's log, sent to a peer in a query for missing entries (the payload of the ``log`` query).

msgpack: ``[mission, [[drone, boot, [first, last, first, last, ...], cut, [block, ...], hashes], ...]]``:

- ranges of sequence numbers in ascending order;
- the first number that does not count, nor its successors; or nil;
- hashes of some blocks of entries, 16 bytes each, so that a peer with different entries under the same numbers notices.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain, pairwise
from typing import Annotated, NamedTuple

import msgpack
import msgspec
from msgspec import Meta, Struct

from radron.protocol.codec import MAX_PAYLOAD_BYTES
from radron.protocol.errors import ProtocolError
from radron.protocol.units import BootId, Count, DroneId, MissionId

BLOCK_ENTRIES = 64  # sequence numbers; block k begins with the number k * BLOCK_ENTRIES
HASH_BYTES = 16
MAX_BLOCKS = 64  # of all publishers together; the next summary has other blocks
MAX_SUMMARY_PUBLISHERS = 256  # one for each start of each agent
MAX_RANGES = 2500  # of all publishers together: fits into a payload at 9 bytes a number


class Held(NamedTuple):
    """The log entries of one publisher (one run of a drone's agent) that a log contains.

    ``ranges``: first and last number of each gapless range of sequence numbers. ``cut``: the first sequence number that is
    ignored, because two signed entries with this number contradict each other (``radron.agent.fusion.log``). ``blocks``: for some
    blocks of consecutive entries, number and hash, so that a peer notices different entries under equal numbers.
    """

    ranges: tuple[tuple[int, int], ...] = ()
    cut: int | None = None
    blocks: tuple[tuple[int, bytes], ...] = ()


Summary = Mapping[tuple[str, str], Held]  # by drone and boot


class _Publisher(Struct, frozen=True, array_like=True):
    drone: DroneId
    boot: BootId
    bounds: Annotated[tuple[Count, ...], Meta(max_length=2 * MAX_RANGES)]
    cut: Count | None
    blocks: Annotated[tuple[Count, ...], Meta(max_length=MAX_BLOCKS)]
    hashes: bytes


class _Document(Struct, frozen=True, array_like=True):
    mission: MissionId
    publishers: Annotated[tuple[_Publisher, ...], Meta(max_length=MAX_SUMMARY_PUBLISHERS)]


def encode_summary(mission: str, summary: Summary) -> bytes:
    """Convert a summary of a log (which entries it contains) to bytes for :func:`decode_summary`.

    If the log has more gaps than fit, the oldest ranges are sent, evenly over the publishers. The peer then sends some entries
    unnecessarily, but the oldest gaps close first, so that repeated queries obtain all entries.
    """
    publishers = list(summary.items())[:MAX_SUMMARY_PUBLISHERS]
    share = MAX_RANGES // max(1, len(publishers))
    payload: bytes = msgpack.packb((mission, [(*publisher, *_told(held, share)) for publisher, held in publishers]))
    return payload


def decode_summary(payload: bytes) -> tuple[str, dict[tuple[str, str], Held]]:
    """Read a summary of a peer's log: return the mission's id, and the contained entries by (drone, boot).

    Raises:
        ProtocolError: for any error in the bytes.
    """
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise ProtocolError(f"summary of {len(payload)} bytes is over the limit of {MAX_PAYLOAD_BYTES}")
    try:
        content = msgpack.unpackb(
            payload,
            use_list=False,
            max_str_len=64,
            max_bin_len=HASH_BYTES * MAX_BLOCKS,
            max_array_len=2 * MAX_RANGES,
            max_map_len=0,
            max_ext_len=0,
        )
        document = msgspec.convert(content, _Document)
    except (ValueError, TypeError, RecursionError, MemoryError, msgpack.UnpackException) as error:
        raise ProtocolError(f"not a summary: {str(error)[:120]}") from None
    if sum(len(entry.blocks) for entry in document.publishers) > MAX_BLOCKS:
        raise ProtocolError(f"not a summary: it has hashes of more than {MAX_BLOCKS} blocks")
    return document.mission, {
        (entry.drone, entry.boot): Held(_ranges(entry.bounds), entry.cut, _blocks(entry)) for entry in document.publishers
    }


def _told(held: Held, share: int) -> tuple[list[int], int | None, list[int], bytes]:
    """Return a publisher's oldest ranges, at most its share, its cut, and its blocks within these ranges with their hashes."""
    ranges, end = held.ranges[:share], held.ranges[share - 1][1] + 1 if len(held.ranges) > share else None
    blocks = [(block, told) for block, told in held.blocks if end is None or (block + 1) * BLOCK_ENTRIES <= end]
    return list(chain.from_iterable(ranges)), held.cut, [block for block, _ in blocks], b"".join(told for _, told in blocks)


def _blocks(entry: _Publisher) -> tuple[tuple[int, bytes], ...]:
    """Return the blocks with their hashes. Raises ProtocolError: not one hash for each block."""
    if len(entry.hashes) != HASH_BYTES * len(entry.blocks):
        raise ProtocolError("not a summary: its blocks and hashes are not equally many")
    starts = range(0, len(entry.hashes), HASH_BYTES)
    return tuple((block, entry.hashes[start : start + HASH_BYTES]) for block, start in zip(entry.blocks, starts, strict=True))


def _ranges(bounds: tuple[int, ...]) -> tuple[tuple[int, int], ...]:
    """Return the pairs of bounds. Raises ProtocolError: incomplete, or not in ascending order."""
    if len(bounds) % 2:
        raise ProtocolError("not a summary: a range has no end")
    ranges = tuple(zip(bounds[::2], bounds[1::2], strict=True))
    if any(first > last for first, last in ranges) or any(before[1] >= after[0] for before, after in pairwise(ranges)):
        raise ProtocolError("not a summary: its ranges are not in order")
    return ranges
