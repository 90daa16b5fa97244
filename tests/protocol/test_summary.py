"""A summary describes a log; anything else is refused."""

import contextlib

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.codec import MAX_PAYLOAD_BYTES
from protocol.errors import ProtocolError
from protocol.summary import decode_summary, encode_summary

MISSION = "0123456789abcdef"
BOOT = "00000000000000aa"
LARGEST = 2**40


@st.composite
def ranges(draw: st.DrawFn) -> tuple[tuple[int, int], ...]:
    bounds = sorted(draw(st.sets(st.integers(0, LARGEST), max_size=20)))
    return tuple(zip(bounds[::2], bounds[1::2], strict=False))


publishers = st.tuples(st.sampled_from(["d1", "d2", "x"]), st.from_regex(r"\A[0-9a-f]{16}\Z"))


@settings(deadline=None)
@given(st.dictionaries(publishers, ranges(), max_size=8))
def test_a_summary_is_read_back(summary: dict[tuple[str, str], tuple[tuple[int, int], ...]]) -> None:
    assert decode_summary(encode_summary(MISSION, summary)) == (MISSION, summary)


@settings(deadline=None)
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
        [MISSION, [["D1", BOOT, []]]],
        [MISSION, [["station", BOOT, []]]],
        [MISSION, [["d1", "boot", []]]],
        [MISSION, [["d1", BOOT, [1]]]],
        [MISSION, [["d1", BOOT, [2, 1]]]],
        [MISSION, [["d1", BOOT, [0, 5, 5, 6]]]],
        [MISSION, [["d1", BOOT, [-1, 5]]]],
        [MISSION, [["d1", BOOT, [0, 2.5]]]],
        [MISSION, [["d1", BOOT, [0, LARGEST + 1]]]],
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
    summary = {("d1", BOOT): gappy, ("d2", BOOT): gappy[:3]}
    payload = encode_summary(MISSION, summary)
    assert len(payload) <= MAX_PAYLOAD_BYTES
    _, told = decode_summary(payload)
    assert told["d1", BOOT] == gappy[: len(told["d1", BOOT])]
    assert len(told["d1", BOOT]) > 1000
    assert told["d2", BOOT] == gappy[:3]


def test_more_starts_of_agents_than_fit_are_left_out() -> None:
    summary = {("d1", f"{boot:016x}"): ((0, 10),) for boot in range(5000)}
    _, told = decode_summary(encode_summary(MISSION, summary))
    assert told.items() <= summary.items()
    assert len(told) > 100
