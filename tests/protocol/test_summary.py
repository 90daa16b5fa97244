"""A summary describes a log; anything else is refused."""

import contextlib

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radron.protocol.codec import MAX_PAYLOAD_BYTES
from radron.protocol.errors import ProtocolError
from radron.protocol.summary import MAX_BLOCKS, MAX_RANGES, MAX_SUMMARY_PUBLISHERS, Held, decode_summary, encode_summary

MISSION = "0123456789abcdef"
BOOT = "00000000000000aa"
LARGEST = 2**40


@st.composite
def ranges(draw: st.DrawFn) -> tuple[tuple[int, int], ...]:
    bounds = sorted(draw(st.sets(st.integers(0, LARGEST), max_size=20)))
    return tuple(zip(bounds[::2], bounds[1::2], strict=False))


@st.composite
def held(draw: st.DrawFn) -> Held:
    blocks = draw(st.dictionaries(st.integers(0, LARGEST), st.binary(min_size=16, max_size=16), max_size=8))
    return Held(draw(ranges()), draw(st.none() | st.integers(0, LARGEST)), tuple(blocks.items()))


publishers = st.tuples(st.sampled_from(["d1", "d2", "x"]), st.from_regex(r"\A[0-9a-f]{16}\Z"))


@given(st.dictionaries(publishers, held(), max_size=8))
def test_a_summary_is_read_back(summary: dict[tuple[str, str], Held]) -> None:
    assert decode_summary(encode_summary(MISSION, summary)) == (MISSION, summary)


@given(st.binary(max_size=200))
def test_any_bytes_are_a_summary_or_refused(payload: bytes) -> None:
    with contextlib.suppress(ProtocolError):
        decode_summary(payload)


@pytest.mark.parametrize(
    "content",
    [
        None,
        [],
        [MISSION],
        ["short", []],
        [MISSION, [["d1", BOOT]]],
        [MISSION, [["d1", BOOT, [0, 5]]]],
        [MISSION, [["D1", BOOT, [], None, [], b""]]],
        [MISSION, [["station", BOOT, [], None, [], b""]]],
        [MISSION, [["d1", "boot", [], None, [], b""]]],
        [MISSION, [["d1", BOOT, [1], None, [], b""]]],
        [MISSION, [["d1", BOOT, [2, 1], None, [], b""]]],
        [MISSION, [["d1", BOOT, [0, 5, 5, 6], None, [], b""]]],
        [MISSION, [["d1", BOOT, [-1, 5], None, [], b""]]],
        [MISSION, [["d1", BOOT, [0, 2.5], None, [], b""]]],
        [MISSION, [["d1", BOOT, [0, LARGEST + 1], None, [], b""]]],
        [MISSION, [["d1", BOOT, [], -1, [], b""]]],
        [MISSION, [["d1", BOOT, [], None, [0], bytes(15)]]],
        [MISSION, [["d1", BOOT, [], None, [], bytes(16)]]],
        [MISSION, [["d1", BOOT, [], None, list(range(65)), bytes(65 * 16)]]],
        [MISSION, [[name, BOOT, [], None, list(range(33)), bytes(33 * 16)] for name in ("d1", "d2")]],
        {"mission": MISSION},
    ],
)
def test_what_is_no_summary_is_refused(content: object) -> None:
    with pytest.raises(ProtocolError, match="not a summary"):
        decode_summary(msgpack.packb(content))


def test_a_payload_over_the_limit_is_refused() -> None:
    with pytest.raises(ProtocolError, match="over the limit"):
        decode_summary(bytes(MAX_PAYLOAD_BYTES + 1))


def test_of_a_log_full_of_gaps_the_oldest_ranges_are_told() -> None:
    gappy = tuple((LARGEST // 2 + 2 * i, LARGEST // 2 + 2 * i) for i in range(20_000))
    blocks = tuple((gappy[at][0] // 64, bytes(16)) for at in (0, -1))
    summary = {("d1", BOOT): Held(gappy, None, blocks), ("d2", BOOT): Held(gappy[:3], 7, blocks[:1])}
    payload = encode_summary(MISSION, summary)
    assert len(payload) <= MAX_PAYLOAD_BYTES
    _, told = decode_summary(payload)
    ranges, _, hashed = told["d1", BOOT]
    assert ranges == gappy[: len(ranges)]
    assert len(ranges) > 1000
    assert hashed == blocks[:1]  # a peer would not know the other's content
    assert told["d2", BOOT] == summary["d2", BOOT]


def test_more_starts_of_agents_than_fit_are_left_out() -> None:
    summary = {("d1", f"{boot:016x}"): Held(((0, 10),)) for boot in range(5000)}
    _, told = decode_summary(encode_summary(MISSION, summary))
    assert told.items() <= summary.items()
    assert len(told) > 100


def test_the_largest_summary_fits_into_a_payload() -> None:
    gappy = tuple((LARGEST // 2 + 2 * i, LARGEST // 2 + 2 * i) for i in range(MAX_RANGES))
    summary = {("d" * 32, f"{boot:016x}"): Held(gappy, LARGEST) for boot in range(MAX_SUMMARY_PUBLISHERS)}
    many = tuple((LARGEST // 2 // 64 + block, bytes(16)) for block in range(MAX_BLOCKS))
    summary["d" * 32, "0" * 16] = Held(((0, LARGEST),), LARGEST, many)
    payload = encode_summary(MISSION, summary)
    assert len(payload) <= MAX_PAYLOAD_BYTES
    assert decode_summary(payload)[1]["d" * 32, "0" * 16] == summary["d" * 32, "0" * 16]
