import struct
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from radron.agent.detector.readout import PixelHits, Readout
from radron.agent.detector.wire import MAXIMUM_HITS, Unpacker, pack
from radron.agent.errors import DetectorError

TICKS = st.integers(-(1 << 50), 1 << 50)
SHORTS = st.integers(0, 65535)


@st.composite
def readouts(draw):
    rows = draw(st.lists(st.tuples(TICKS, SHORTS, SHORTS), max_size=20))
    start_ns = draw(st.integers(0, 1 << 61))
    length_ns = draw(st.integers(0, 10**12))
    live_s = draw(st.floats(0.0, 1.0)) * length_ns * 1e-9
    table = np.array(rows, np.int64).reshape(-1, 3)
    hits = PixelHits(table[:, 0], table[:, 1].astype(np.uint16), table[:, 2].astype(np.uint16))
    return Readout(start_ns, start_ns + length_ns, draw(st.integers(0, 1 << 61)), live_s, hits, draw(st.integers(0, 1 << 31)))


def same(a, b):
    arrays = ("tick", "index", "tot")
    return all(np.array_equal(getattr(a.hits, name), getattr(b.hits, name)) for name in arrays) and all(
        getattr(a, name) == getattr(b, name) for name in ("start_ns", "end_ns", "clock_ns", "live_time_s", "lost_hits")
    )


@given(st.lists(readouts(), max_size=4), st.integers(1, 70))
def test_a_stream_cut_anywhere_gives_the_readouts_again(sent, cut):
    stream = b"".join(map(pack, sent))
    unpacker = Unpacker()
    received = [readout for at in range(0, len(stream), cut) for readout in unpacker.feed(stream[at : at + cut])]
    assert len(received) == len(sent)
    assert all(map(same, received, sent))


@given(readouts(), st.data())
def test_a_changed_byte_gives_a_readout_that_holds_together_or_the_one_error(readout, data):
    frame = bytearray(pack(readout))
    at = data.draw(st.integers(0, len(frame) - 1))
    frame[at] ^= data.draw(st.integers(1, 255))
    received = []
    with suppress(DetectorError):
        received += Unpacker().feed(bytes(frame))
    for one in received:
        assert one.start_ns <= one.end_ns
        assert 0.0 <= one.live_time_s <= (one.end_ns - one.start_ns) * 1e-9 + 1e-6
        assert len(one.hits.tick) == len(one.hits.index) == len(one.hits.tot)


@given(st.binary(max_size=300))
def test_noise_is_refused_or_waits_for_more(noise):
    unpacker = Unpacker()
    try:
        list(unpacker.feed(noise))
    except DetectorError:
        return
    assert len(unpacker._buffer) <= len(noise)


def test_a_length_beyond_the_limit_is_refused_before_its_content_comes():
    with pytest.raises(DetectorError, match="frame of 4294967295 bytes"):
        list(Unpacker().feed(struct.pack("<I", 0xFFFFFFFF)))


def test_another_version_is_named():
    frame = bytearray(pack(Readout(0, 1, 0, 0.0, PixelHits(*(np.empty(0, kind) for kind in (np.int64, np.uint16, np.uint16))))))
    frame[4] = 9
    with pytest.raises(DetectorError, match="version 9, known are 1 and 2"):
        list(Unpacker().feed(bytes(frame)))


def test_a_readout_that_fits_no_frame_is_not_sent():
    count = MAXIMUM_HITS + 1
    hits = PixelHits(np.zeros(count, np.int64), np.zeros(count, np.uint16), np.zeros(count, np.uint16))
    with pytest.raises(DetectorError, match="make readouts shorter"):
        pack(Readout(0, 1, 0, 0.0, hits))


@pytest.mark.parametrize("live_s", [float("nan"), float("inf"), -1.0, 2.0])
def test_an_impossible_live_time_is_refused(live_s):
    hits = PixelHits(np.empty(0, np.int64), np.empty(0, np.uint16), np.empty(0, np.uint16))
    with pytest.raises(DetectorError, match="live for"):
        list(Unpacker().feed(pack(Readout(0, 10**9, 0, live_s, hits))))


@given(st.lists(st.integers(0, 2**32 - 1), min_size=1, max_size=40), st.integers(1, 70))
def test_readouts_of_ordinary_detectors(counts, cut):
    sent = Readout(5, 10**9, 5, 0.5, PixelHits.none(), counts=np.array(counts))
    stream = pack(sent) + pack(replace(sent, counts=None))
    unpacker = Unpacker()
    one, camera = [readout for at in range(0, len(stream), cut) for readout in unpacker.feed(stream[at : at + cut])]
    assert same(one, sent)
    assert one.counts.tolist() == counts
    assert camera.counts is None


def test_readouts_with_too_many_channels_or_with_hits_and_counts_are_refused():
    hits = PixelHits(np.array([1]), np.array([1], np.uint16), np.array([1], np.uint16))
    sent = Readout(5, 10**9, 5, 0.5, PixelHits.none(), counts=np.array([1]))
    for wrong in (replace(sent, hits=hits), replace(sent, counts=np.ones(16_385, int)), replace(sent, counts=np.ones(0, int))):
        with pytest.raises(DetectorError, match="channels"):
            pack(wrong)
    frame = pack(sent)
    with pytest.raises(DetectorError, match="not a readout"):
        list(Unpacker().feed(struct.pack("<I", len(frame) - 4 + 1) + frame[4:] + b"\0"))
