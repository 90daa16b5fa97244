"""Binary frames of readouts on a detector's TCP feed.

A frame is, little-endian: the length of what follows (4 bytes), the version (1), start_ns, end_ns, clock_ns (8 each), live_time_s
(8, IEEE 754), lost_hits (4), the number of hits N (4), then tick (N times 8), index (N times 2) and tot (N times 2). Version 1 is
of a camera. Version 2 is of an ordinary detector: N is 0, and its counts follow, 4 bytes for each of its channels.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator

import numpy as np

from radron.agent.detector.readout import PixelHits, Readout
from radron.agent.errors import DetectorError
from radron.protocol.versions import READOUT, READOUT_WITH_COUNTS

MAXIMUM_HITS = 1_000_000  # per frame: more than twice what a MiniPIX can deliver in 0.2 s
MAX_DEVICE_CHANNELS = 16_384  # of an ordinary detector
_LENGTH = struct.Struct("<I")
_HEADER = struct.Struct("<BqqqdII")
_HIT_BYTES = 12
_MAXIMUM_BYTES = _HEADER.size + MAXIMUM_HITS * _HIT_BYTES
_LAST_NS = 1 << 62
_LAST_TICK = 1 << 57  # seven years: 25 times as much still fits 64 bits
_ROUNDING_S = 1e-6  # tolerance of the live time against the difference of the stamps


def pack(readout: Readout) -> bytes:
    """Encode one readout (pixel hits of one interval) as a binary frame for the TCP feed.

    Raises:
        DetectorError: more than ``MAXIMUM_HITS`` hits, or more than ``MAX_DEVICE_CHANNELS`` channels.
    """
    hits = readout.hits
    count = len(hits)
    if count > MAXIMUM_HITS:
        raise DetectorError(f"a readout of {count} hits does not fit a frame (at most {MAXIMUM_HITS}); make readouts shorter")
    lost = min(readout.lost_hits, 0xFFFFFFFF)
    stamps = readout.start_ns, readout.end_ns, readout.clock_ns
    if readout.counts is not None:
        counts = np.minimum(readout.counts, 0xFFFFFFFF).astype("<u4").tobytes()
        if not 0 < len(readout.counts) <= MAX_DEVICE_CHANNELS or count:
            raise DetectorError(f"a readout of {len(readout.counts)} channels and {count} hits: it has the one or the other")
        header = _HEADER.pack(READOUT_WITH_COUNTS, *stamps, readout.live_time_s, lost, 0)
        return b"".join((_LENGTH.pack(_HEADER.size + len(counts)), header, counts))
    header = _HEADER.pack(READOUT, *stamps, readout.live_time_s, lost, count)
    arrays = (hits.tick.astype("<i8").tobytes(), hits.index.astype("<u2").tobytes(), hits.tot.astype("<u2").tobytes())
    return b"".join((_LENGTH.pack(_HEADER.size + count * _HIT_BYTES), header, *arrays))


class Unpacker:
    """Decodes a stream of bytes, divided anywhere, into readouts. It buffers at most one frame beside its input."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> Iterator[Readout]:
        """Yield the readouts that are complete with these further bytes; readouts before a corrupt frame are yielded before the
        error.

        Raises:
            DetectorError: the bytes are not a stream of readouts; all later bytes are unusable, and the link must be reopened.
        """
        self._buffer += data
        while len(self._buffer) >= _LENGTH.size:
            (length,) = _LENGTH.unpack_from(self._buffer)
            if not _HEADER.size <= length <= _MAXIMUM_BYTES:
                raise DetectorError(f"not a readout: a frame of {length} bytes")
            end = _LENGTH.size + length
            if len(self._buffer) < end:
                break
            frame = bytes(self._buffer[_LENGTH.size : end])
            del self._buffer[:end]
            yield _unpack(frame)


def _unpack(frame: bytes) -> Readout:
    """A frame without its length."""
    version, start_ns, end_ns, clock_ns, live_time_s, lost_hits, count = _HEADER.unpack_from(frame)
    if version not in {READOUT, READOUT_WITH_COUNTS}:
        known = f"{READOUT} and {READOUT_WITH_COUNTS}"
        raise DetectorError(f"readouts of version {version}, known are {known}; both ends must have the same radron")
    place, counts = _HEADER.size, None
    if version == READOUT_WITH_COUNTS:
        channels, rest = divmod(len(frame) - place, 4)
        if count or rest or not 0 < channels <= MAX_DEVICE_CHANNELS:
            raise DetectorError(f"not a readout: {count} hits and channels in {len(frame)} bytes")
        counts = np.frombuffer(frame, "<u4", channels, place).astype(np.int64)
    elif len(frame) != place + count * _HIT_BYTES:
        raise DetectorError(f"not a readout: {count} hits in {len(frame)} bytes")
    if not (0 <= start_ns <= end_ns < _LAST_NS and 0 <= clock_ns < _LAST_NS):
        raise DetectorError(f"not a readout: from {start_ns} to {end_ns} ns, clock {clock_ns} ns")
    if not (math.isfinite(live_time_s) and 0.0 <= live_time_s <= (end_ns - start_ns) * 1e-9 + _ROUNDING_S):
        raise DetectorError(f"not a readout: live for {live_time_s:g} s of {(end_ns - start_ns) * 1e-9:g} s")
    tick = np.frombuffer(frame, "<i8", count, place).astype(np.int64)
    index = np.frombuffer(frame, "<u2", count, place + 8 * count).astype(np.uint16)
    tot = np.frombuffer(frame, "<u2", count, place + 10 * count).astype(np.uint16)
    if count and (tick.min() <= -_LAST_TICK or tick.max() >= _LAST_TICK):
        raise DetectorError("not a readout: a time of arrival out of range")
    return Readout(start_ns, end_ns, clock_ns, live_time_s, PixelHits(tick, index, tot), lost_hits, counts=counts)
