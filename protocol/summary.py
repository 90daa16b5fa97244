"""Summary of a log that a drone sends to a peer when it asks for missing entries (the payload of the ``log`` query).

msgpack: ``[mission, [[drone, boot, [first, last, first, last, ...]], ...]]``, ranges of sequence numbers in ascending order.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain, pairwise
from typing import Annotated

import msgpack
import msgspec
from msgspec import Meta, Struct

from protocol.codec import MAX_PAYLOAD_BYTES
from protocol.errors import ProtocolError
from protocol.units import BootId, Count, DroneId, MissionId

MOST_PUBLISHERS = 512  # one for each start of each agent
MOST_RANGES = 3072  # of all publishers together: fits into a payload at 9 bytes a number

Summary = Mapping[tuple[str, str], tuple[tuple[int, int], ...]]  # (drone, boot) -> (first, last) of the sequences held


class _Publisher(Struct, frozen=True, array_like=True):
    drone: DroneId
    boot: BootId
    bounds: Annotated[tuple[Count, ...], Meta(max_length=2 * MOST_RANGES)]


class _Document(Struct, frozen=True, array_like=True):
    mission: MissionId
    publishers: Annotated[tuple[_Publisher, ...], Meta(max_length=MOST_PUBLISHERS)]


def encode_summary(mission: str, summary: Summary) -> bytes:
    """Encode; the result is accepted by :func:`decode_summary`.

    Of a log with more gaps than fit, the oldest ranges are sent, evenly over the publishers. Entries left out of the summary are
    sent again unnecessarily, but the oldest gaps close first, so that repeated queries obtain everything.
    """
    publishers = list(summary.items())[:MOST_PUBLISHERS]
    share = MOST_RANGES // max(1, len(publishers))
    payload: bytes = msgpack.packb(
        (mission, [(drone, boot, list(chain.from_iterable(ranges[:share]))) for (drone, boot), ranges in publishers])
    )
    return payload


def decode_summary(payload: bytes) -> tuple[str, dict[tuple[str, str], tuple[tuple[int, int], ...]]]:
    """Mission id and ranges by (drone, boot).

    Raises:
        ProtocolError: for any error in the bytes.
    """
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise ProtocolError(f"summary of {len(payload)} bytes is over the limit of {MAX_PAYLOAD_BYTES}")
    try:
        content = msgpack.unpackb(
            payload, use_list=False, max_str_len=64, max_bin_len=0, max_array_len=2 * MOST_RANGES, max_map_len=0, max_ext_len=0
        )
        document = msgspec.convert(content, _Document)
    except (ValueError, TypeError, RecursionError, MemoryError, msgpack.UnpackException) as error:
        raise ProtocolError(f"not a summary: {str(error)[:120]}") from None
    return document.mission, {(entry.drone, entry.boot): _ranges(entry.bounds) for entry in document.publishers}


def _ranges(bounds: tuple[int, ...]) -> tuple[tuple[int, int], ...]:
    """Pairs of bounds; they must be complete and in ascending order."""
    if len(bounds) % 2:
        raise ProtocolError("not a summary: a range has no end")
    ranges = tuple(zip(bounds[::2], bounds[1::2], strict=True))
    if any(first > last for first, last in ranges) or any(before[1] >= after[0] for before, after in pairwise(ranges)):
        raise ProtocolError("not a summary: its ranges are not in order")
    return ranges
