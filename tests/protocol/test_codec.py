"""Valid messages come back as they were; everything else ends in one ProtocolError."""

import contextlib
import math
from collections.abc import Iterator
from typing import Any

import msgpack
import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radron.protocol.codec import MAX_ENTRY_BYTES, MAX_PAYLOAD_BYTES, decode, decode_as, decode_from, encode
from radron.protocol.contamination import Block, Contamination, Finding, Range
from radron.protocol.entries import Cone, ConeOrder, Counts, Coverage, Credential, Exposure, PoseSample, Retraction, Sighting
from radron.protocol.errors import ProtocolError
from radron.protocol.keys import command_key, drone_key, key_of
from radron.protocol.message import Message
from radron.protocol.messages import KINDS, Command, Estimate, Frame, Plan, Pose, Source, Status, Ticket
from radron.protocol.spectrum import SpectrumBin
from support.flights.schema_messages import document, messages

POSE = Pose(
    stamp_ns=1,
    drone="uav1",
    epoch=0,
    position_m=(1.0, 2.0, 3.0),
    velocity_mps=(0.0, 0.0, 0.0),
    quaternion=(1.0, 0.0, 0.0, 0.0),
    position_sigma_m=0.1,
    yaw_sigma_rad=0.05,
)
HEX = "0123456789abcdef"
EXPOSURE = Exposure(
    stamp_ns=1_000_000_000,
    drone="uav1",
    mission=HEX,
    boot=HEX,
    sequence=7,
    epoch=0,
    end_ns=1_500_000_000,
    live_time_s=0.49,
    counts=Counts(3, 1, 0),
    poses=(PoseSample(0, (0.0, 0.0, 3.0), (1.0, 0.0, 0.0, 0.0)), PoseSample(100_000_000, (0.3, 0.0, 3.0), (1.0, 0.0, 0.0, 0.0))),
    position_sigma_m=0.1,
    yaw_sigma_rad=0.05,
)


def refused(payload: bytes) -> str:
    with pytest.raises(ProtocolError) as caught:
        decode(payload)
    return str(caught.value)


def packed(message: Message, **changes: Any) -> bytes:
    return msgpack.packb({**document(message), **changes})


@pytest.mark.parametrize("kind", KINDS)
def test_round_trip(kind: str) -> None:
    @settings(max_examples=25)
    @given(messages(kind))
    def every(message: Message) -> None:
        payload = encode(message)
        assert decode(payload) == message
        assert type(decode(payload)) is type(message)
        assert encode(decode(payload)) == payload
        assert decode_from(key_of("swarm-1", message), payload) == message
        assert decode_as(type(message), payload) == message
        other = next(one for one in KINDS.values() if one is not type(message))
        with pytest.raises(ProtocolError, match=f"a {type(message).__name__.lower()} as a {other.__name__.lower()}"):
            decode_as(other, payload)

    every()


def test_what_was_accepted_although_binary_is_written_as_text_is_read_again() -> None:
    """Found by ``make fuzz``: no member signs such an entry, but without certificates it is in the log."""
    entry = Credential(stamp_ns=1, drone="d1", mission="0" * 16, boot="1" * 16, sequence=0, certificate=b"YWJj")
    payload = packed(entry, certificate="YWJj")
    assert decode_as(Credential, payload) == decode(payload)


@settings(max_examples=50)
@given(
    messages(),
    st.dictionaries(st.from_regex(r"\Ax_[a-z]{1,8}\Z"), st.integers(0, 9) | st.text(max_size=5) | st.none(), max_size=4),
)
def test_unknown_fields_are_ignored(message: Message, extra: dict[str, Any]) -> None:
    assert decode(packed(message, **extra)) == message
    assert decode_as(type(message), packed(message, **extra)) == message


@pytest.mark.parametrize("kind", KINDS)
def test_a_missing_field_is_refused(kind: str) -> None:
    @settings(max_examples=5)
    @given(messages(kind))
    def every(message: Message) -> None:
        for field in msgspec.structs.fields(message):
            if field.required:
                fields = document(message)
                del fields[field.name]
                assert field.name in refused(msgpack.packb(fields))
        fields = document(message)
        del fields["kind"]
        refused(msgpack.packb(fields))

    every()


def leaves(value: Any, way: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The ways to every value in a document, the lists and maps themselves included."""
    if way:
        yield way
    if isinstance(value, dict):
        for key, item in value.items():
            yield from leaves(item, (*way, key))
    elif isinstance(value, list | tuple):
        for number, item in enumerate(value):
            yield from leaves(item, (*way, number))


def replaced(value: Any, way: tuple[Any, ...], new: Any) -> Any:
    if not way:
        return new
    if isinstance(value, dict):
        return {key: replaced(item, way[1:], new) if key == way[0] else item for key, item in value.items()}
    return [replaced(item, way[1:], new) if number == way[0] else item for number, item in enumerate(value)]


NUMBERS_THAT_NEVER_FIT = [math.nan, math.inf, -math.inf, 1e300, -1e300, 2**63, 2**64 - 1, -(2**63)]
FREE_TEXT = ("problems", "finding")
NEVER_A_FIELD = [*NUMBERS_THAT_NEVER_FIT, {"a": {"b": {}}}, [[[[]]]], "A b", b"\xff" * 2000, True]


@settings(max_examples=100)
@given(st.data(), messages(), st.sampled_from(NEVER_A_FIELD))
def test_a_value_that_cannot_be_is_refused_wherever_it_stands(data: st.DataObject, message: Message, value: Any) -> None:
    fields = document(message)
    flags = ("steered", "in_air", "disowns")
    ways = [way for way in leaves(fields) if way[0] not in FREE_TEXT and (way[0] not in flags or value is not True)]
    way = data.draw(st.sampled_from(ways))
    refused(msgpack.packb(replaced(fields, way, value)))


@settings(max_examples=100)
@given(
    st.data(), messages(), st.none() | st.integers() | st.floats() | st.text(max_size=20) | st.lists(st.integers(), max_size=3)
)
def test_any_value_anywhere_is_read_or_refused(data: st.DataObject, message: Message, value: Any) -> None:
    fields = document(message)
    way = data.draw(st.sampled_from(list(leaves(fields))))
    try:
        payload = msgpack.packb(replaced(fields, way, value))
    except OverflowError:
        return  # msgpack has no such integer
    with contextlib.suppress(ProtocolError):
        assert isinstance(decode(payload), Message)


@settings(max_examples=100)
@given(st.data(), messages())
def test_mutated_bytes_are_read_or_refused(data: st.DataObject, message: Message) -> None:
    payload = bytearray(encode(message))
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(payload)))
        cut = data.draw(st.integers(0, 3))
        payload[place : place + cut] = data.draw(st.binary(max_size=4))
    read = None
    with contextlib.suppress(ProtocolError):
        read = decode(bytes(payload))
        assert isinstance(read, Message)
    key = key_of("swarm-1", message)
    if read is not None and key_of("swarm-1", read) == key:
        assert decode_from(key, bytes(payload)) == read
    else:
        with pytest.raises(ProtocolError):
            decode_from(key, bytes(payload))


@settings(max_examples=300)
@given(st.binary(max_size=200))
def test_random_bytes_are_refused(payload: bytes) -> None:
    refused(payload)


@settings(max_examples=20)
@given(messages())
def test_truncated_and_lengthened_payloads_are_refused(message: Message) -> None:
    payload = encode(message)
    for end in range(len(payload)):
        refused(payload[:end])
    refused(payload + b"\x00")


def test_sizes_are_limited() -> None:
    assert "65537 bytes" in refused(bytes(MAX_PAYLOAD_BYTES + 1))
    refused(packed(POSE, x="x" * 2000))
    refused(packed(POSE, x=list(range(2000))))
    refused(packed(POSE, x={str(number): number for number in range(200)}))
    refused(b"\xdd\xff\xff\xff\xff" + bytes(100))  # says it is a list of four billion
    refused(b"\xdb\xff\xff\xff\xff" + bytes(100))  # a text of four gigabytes


@pytest.mark.parametrize("nest", [b"\x91", b"\x81\xa1a", b"\x81\xa4kind\x91"])
def test_deep_nesting_is_refused(nest: bytes) -> None:
    refused(nest * (MAX_PAYLOAD_BYTES // len(nest)))
    for depth in (10, 100, 500, 1000, 3000):
        refused(nest * depth + b"\x01")


def test_the_largest_messages_fit() -> None:
    counters = {f"{number:>064}": 2**40 for number in range(64)}
    status = Status(
        stamp_ns=1, drone="d", mission=HEX, boot=HEX, stage="hold", counters=counters, problems=("\U0001f6f8" * 256,) * 32
    )
    for message in (exposure_of(16), status):
        assert decode(encode(message)) == message


def exposure_of(poses: int) -> Exposure:
    """An exposure with so many poses, far from the origin."""
    samples = tuple(PoseSample(number * 10**8, (-99_999.123456789,) * 3, (0.5, 0.5, 0.5, 0.5)) for number in range(poses))
    return msgspec.structs.replace(EXPOSURE, poses=samples, end_ns=EXPOSURE.stamp_ns + poses * 10**8)


def test_a_log_entry_of_more_than_2_kb_is_refused() -> None:
    """Every agent keeps all entries in memory until the mission ends; of other messages the newest only."""
    large = exposure_of(40)
    payload = msgspec.msgpack.encode(large)
    assert MAX_ENTRY_BYTES < len(payload) < MAX_PAYLOAD_BYTES
    assert f"over the limit of {MAX_ENTRY_BYTES}" in refused(payload)
    with pytest.raises(ProtocolError, match=f"over the limit of {MAX_ENTRY_BYTES}"):
        decode_from(key_of("s", large), payload)
    with pytest.raises(ProtocolError, match=f"over the limit of {MAX_ENTRY_BYTES}"):
        encode(large)


def test_map_keys() -> None:
    twice = packed(POSE)
    assert twice[0] == 0x80 + len(document(POSE))
    twice = bytes([twice[0] + 1]) + twice[1:] + msgpack.packb("epoch") + msgpack.packb(1)
    assert "twice" in refused(twice)
    refused(msgpack.packb({**document(POSE), 1: 2}))
    refused(msgpack.packb({**document(POSE), b"x": 2}))
    refused(msgpack.packb({**document(POSE), None: 2}, strict_types=False))


@pytest.mark.parametrize("extension", [msgpack.ExtType(5, b""), msgpack.ExtType(5, b"abcd"), msgpack.Timestamp(1, 1)])
def test_extension_types_are_refused_even_in_unknown_fields(extension: Any) -> None:
    refused(packed(POSE, x=extension))
    refused(msgpack.packb(extension))


@pytest.mark.parametrize("value", [None, 1, 1.5, "pose", [], {}, [1, 2], {"kind": 1}, {"kind": "pilot"}, {"kind": ["pose"]}])
def test_what_is_no_message_is_refused(value: Any) -> None:
    refused(msgpack.packb(value))


@pytest.mark.parametrize("drone", ["UAV1", "", "-a", "a b", "a\n", "a/b", "a" * 33, "station", "ä"])
def test_drone_ids_are_checked(drone: str) -> None:
    refused(packed(POSE, drone=drone))


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"end_ns": EXPOSURE.stamp_ns}, "ends before it begins"),
        ({"live_time_s": 0.51}, "live time"),
        ({"poses": EXPOSURE.poses[::-1]}, "order of time"),
        ({"end_ns": EXPOSURE.stamp_ns + 50_000_000, "live_time_s": 0.01}, "outside"),
        ({"poses": (PoseSample(0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)),)}, "unit norm"),
    ],
)
def test_exposures_that_contradict_themselves_are_refused(changes: dict[str, Any], text: str) -> None:
    assert decode(encode(EXPOSURE)) == EXPOSURE
    with pytest.raises(ProtocolError, match=text):
        encode(msgspec.structs.replace(EXPOSURE, **changes))


SENDER = {"stamp_ns": 1, "drone": "uav1"}
ENTRY = {**SENDER, "mission": HEX, "boot": HEX, "sequence": 0, "epoch": 0}
ORDER = ConeOrder((1.0, 0.0, 0.0), 0.5, 0.1, 0.5)
CONE = Cone(
    **ENTRY, apex_m=(0.0, 0.0, 3.0), apex_sigma_m=0.0, yaw_sigma_rad=0.0, orders=(ORDER, ORDER),
    energies_kev=(300.0, 361.0), energy_sigmas_kev=(6.0, 7.0), separation_mm=1.0,
)  # fmt: skip
PLAN = Plan(**SENDER, epoch=0, step_ns=200_000_000, positions_m=((0.0, 0.0, 3.0), (24.0, 32.0, 3.0), (24.0, 32.0, 3.0)))
SIGHTING = Sighting(
    **ENTRY, target="uav2", position_m=(0.0, 0.0, 3.0), direction=(0.0, 1.0, 0.0), direction_sigma_rad=0.01
)  # fmt: skip
COVERAGE = Coverage(**ENTRY, path_m=((0.0, 0.0),), swath_m=10.0)
RETRACTION = Retraction(**SENDER, mission=HEX, boot=HEX, sequence=9, first=4, last=8)


def sources(*covariance_m2: float) -> tuple[Source, ...]:
    return (Source(position_m=(0.0,) * 3, covariance_m2=covariance_m2),)


ESTIMATE = Estimate(**SENDER, mission=HEX, estimator="paper", digest=HEX * 2, sources=sources(4.0, 2.0, 0.0, 1.0, 0.0, 0.0))
MAP = Contamination(
    nuclide="Cs-137",
    finding=Finding.AREA,
    evidences={},
    total_bq=Range(4e8, 3e8, 5e8),
    least_bqm2=1e4,
    corner_m=(0.0, 0.0),
    block_m=10.0,
    across=2,
    unit_bqm2=200.0,
    blocks=(Block(0, 0, 1), Block(1, 0, 2), Block(2, 1, 3), Block(3, 2, 4)),
    highest_bqm2=Range(600.0, 400.0, 800.0),
    highest_m=(15.0, 15.0, 0.0),
    dose_svph=Range(0.0, 0.0, 0.0),
    dose_m=(15.0, 15.0, 0.0),
)
MAPPED = msgspec.structs.replace(ESTIMATE, contamination=MAP)


def mapped(**changes: Any) -> dict[str, Contamination]:
    return {"contamination": msgspec.structs.replace(MAP, **changes)}


FRAME = Frame(**SENDER, epoch=0, translation_m=(0.0,) * 3, yaw_rad=0.0, covariance=(0.0,) * 16)


def orders(first: float, second: float) -> tuple[ConeOrder, ConeOrder]:
    return tuple(msgspec.structs.replace(ORDER, probability=probability) for probability in (first, second))


@pytest.mark.parametrize(
    ("message", "changes", "text"),
    [
        (POSE, {"quaternion": (0.0, 0.0, 0.0, 0.0)}, "unit norm"),
        (CONE, {"orders": (ORDER, msgspec.structs.replace(ORDER, axis=(0.5, 0.0, 0.0)))}, "unit vector"),
        (CONE, {"orders": (ORDER, msgspec.structs.replace(ORDER, sigma_rad=0.0))}, "sigma_rad|>= 0.0001"),
        (CONE, {"orders": orders(0.0, 0.0)}, "add up to 0"),
        (CONE, {"orders": orders(0.6, 0.6)}, "more than 1"),
        (CONE, {"energies_kev": (0.0, 661.0)}, "energies_kev"),
        (CONE, {"energy_sigmas_kev": (5.0, 0.0)}, "energy_sigmas_kev"),
        (CONE, {"separation_mm": 0.0}, "separation_mm"),
        (EXPOSURE, {"end_ns": EXPOSURE.stamp_ns + 60_000_000_001}, "longer than a minute"),
        (EXPOSURE, {"spectrum": (SpectrumBin(5, 1, 0), SpectrumBin(4, 1, 0))}, "order of energy"),
        (EXPOSURE, {"spectrum": (SpectrumBin(5, 1, 0), SpectrumBin(5, 0, 1))}, "order of energy"),
        (EXPOSURE, {"spectrum": (SpectrumBin(32, 1, 0),)}, "<= 31"),
        (SIGHTING, {"direction": (0.0, 0.0, 0.0)}, "unit vector"),
        (SIGHTING, {"direction_sigma_rad": 0.0}, "direction_sigma_rad"),
        (SIGHTING, {"target": "uav1"}, "drone itself"),
        (SIGHTING, {"range_m": 10.0}, "one is missing"),
        (SIGHTING, {"range_sigma_m": 1.0}, "one is missing"),
        (COVERAGE, {"swath_m": 0.0}, "swath_m"),
        (RETRACTION, {"first": 9}, "earlier entries"),
        (RETRACTION, {"last": 9}, "earlier entries"),
        (PLAN, {"step_ns": 0}, "step_ns"),
        (PLAN, {"step_ns": 1}, "step_ns"),
        (PLAN, {"step_ns": 10_000_000_001}, "step_ns"),
        (PLAN, {"step_ns": 199_000_000}, "jumps"),
        (PLAN, {"positions_m": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -41.0))}, "jumps"),
        (ESTIMATE, {"sources": sources(1.0, 0.0, 0.0, 1.0, 0.0, -1.0)}, "variance is negative"),
        (ESTIMATE, {"sources": sources(4.0, 2.1, 0.0, 1.0, 0.0, 0.0)}, "correlation"),
        (ESTIMATE, {"sources": sources(4.0, 0.0, 1e-3, 1.0, 0.0, 0.0)}, "correlation"),
        (MAPPED, mapped(across=3), "4 blocks are no whole rows of 3"),
        (MAPPED, mapped(blocks=(Block(0, 1, 2), Block(0, 0, 0))), "between the quantiles"),
        (MAPPED, mapped(total_bq=Range(6e8, 3e8, 5e8)), "between the quantiles"),
        (FRAME, {"covariance": (1.0, 0.5, 0.0, 0.0, 0.4, 1.0, *(0.0,) * 10)}, "symmetric"),
    ],
)
def test_what_can_never_be_meant_is_refused(message: Message, changes: dict[str, Any], text: str) -> None:
    assert decode(encode(message)) == message
    with pytest.raises(ProtocolError, match=text):
        encode(msgspec.structs.replace(message, **changes))
    with pytest.raises(ProtocolError, match=text):
        decode(packed(msgspec.structs.replace(message, **changes)))


def test_what_is_known_exactly_may_be_said() -> None:
    """Sums of probabilities just off by rounding, one position alone, no range, zero covariances."""
    for message in (
        msgspec.structs.replace(CONE, orders=orders(0.3, 0.1 + 0.2 + 0.4)),
        msgspec.structs.replace(CONE, orders=orders(0.0, 1.0)),
        msgspec.structs.replace(PLAN, positions_m=PLAN.positions_m[:1]),
        msgspec.structs.replace(SIGHTING, range_m=0.0, range_sigma_m=0.5),
        msgspec.structs.replace(ESTIMATE, sources=sources(*(0.0,) * 6)),
    ):
        assert decode(encode(message)) == message


@pytest.mark.parametrize(
    "changes",
    [
        {"stamp_ns": 2**70},
        {"stamp_ns": -1},
        {"stamp_ns": "now"},
        {"stamp_ns": np.int64(3)},
        {"position_sigma_m": math.nan},
        {"position_sigma_m": np.float64(1.0)},
        {"position_m": (math.inf, 0.0, 0.0)},
        {"position_m": (0.0, 0.0)},
        {"drone": "\ud800"},
        {"epoch": object()},
    ],
)
def test_what_breaks_the_schema_is_not_sent(changes: dict[str, Any]) -> None:
    with pytest.raises(ProtocolError):
        encode(msgspec.structs.replace(POSE, **changes))


def test_the_key_must_fit_the_message() -> None:
    payload = encode(POSE)
    assert decode_from(drone_key("s", "uav1", "pose"), payload) == POSE
    for key in (
        drone_key("s", "uav2", "pose"),
        drone_key("s", "uav1", "plan"),
        command_key("s", "uav1"),
        "radron/2/s/uav1/alive",
    ):
        with pytest.raises(ProtocolError):
            decode_from(key, payload)
    command = Command(stamp_ns=1, station="tower", mission=HEX, action="start", to={"d1": Ticket(HEX, 1)})
    assert decode_from(command_key("s", "tower"), encode(command)) == command
    with pytest.raises(ProtocolError):
        decode_from(command_key("s", "hangar"), encode(command))


def test_under_a_key_nothing_is_read_that_is_refused_without_one() -> None:
    key = drone_key("s", "uav1", "pose")
    as_written = encode(POSE)
    assert decode_from(key, packed(POSE, epoch=0, x=1)) == decode_from(key, packed(POSE, stamp_ns=1)) == POSE
    twice = bytes([as_written[0] + 1]) + as_written[1:] + msgpack.packb("epoch") + msgpack.packb(0)
    bent = packed(POSE, quaternion=(0.0, 0.0, 0.0, 0.0))
    wide = as_written + bytes(MAX_PAYLOAD_BYTES)
    for payload in (twice, bent, wide, packed(POSE, x=msgpack.ExtType(5, b"")), as_written[:-1], as_written + b"\x00"):
        with pytest.raises(ProtocolError):
            decode(payload)
        with pytest.raises(ProtocolError):
            decode_from(key, payload)
