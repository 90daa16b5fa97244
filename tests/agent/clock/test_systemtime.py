"""The autopilot's time, overheard on its link."""

from __future__ import annotations

import asyncio
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Thread

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v10 import common as first_version
from pymavlink.dialects.v20 import common as mavlink

from radron.agent.clock.systemtime import overheard_time, time_in
from support.mesh.meshes import free_port

UTC_US = 1_800_000_000_123_456
TIME = mavlink.MAVLink_system_time_message(UTC_US, 7340)
HEARTBEAT = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, 81, 0, 3, 3)


def sent(*messages: mavlink.MAVLink_message, system: int = 1, component: int = 1, signs: bool = False) -> bytes:
    sender = mavlink.MAVLink(None, system, component)
    if signs:
        sender.signing.secret_key, sender.signing.timestamp, sender.signing.sign_outgoing = bytes(32), 1, True
    return b"".join(bytes(message.pack(sender)) for message in messages)


@pytest.mark.parametrize("signs", [True, False])
def test_the_time_is_found_wherever_the_bytes_begin_and_end(signs: bool) -> None:
    data = sent(HEARTBEAT, TIME, HEARTBEAT, signs=signs)
    begins = len(sent(HEARTBEAT, signs=signs))
    ends = begins + len(sent(TIME))  # a signature behind it is not waited for
    assert [time_in(data[:end]) for end in range(ends)] == [None] * ends
    assert {time_in(data[begin:]) for begin in range(begins + 1)} == {UTC_US * 1000}
    assert time_in(data[begins + 1 :]) is None


def test_the_first_version_of_mavlink_is_understood_too() -> None:
    old = first_version.MAVLink_system_time_message(UTC_US, 7340).pack(first_version.MAVLink(None, 1, 1))
    assert time_in(bytes(old)) == UTC_US * 1000


def test_zeros_that_are_not_sent_are_zeros() -> None:
    short = sent(mavlink.MAVLink_system_time_message(UTC_US, 0))
    assert len(short) < len(sent(TIME))
    assert time_in(short) == UTC_US * 1000


def test_the_newest_time_counts() -> None:
    later = mavlink.MAVLink_system_time_message(UTC_US + 1_000_000, 8340)
    assert time_in(sent(TIME, later)) == (UTC_US + 1_000_000) * 1000


@pytest.mark.parametrize(
    "data",
    [
        b"",
        bytes(range(256)) * 4,
        sent(HEARTBEAT),
        sent(mavlink.MAVLink_system_time_message(0, 7340)),  # unknown to it
        sent(TIME, component=190),  # a ground station's
        sent(TIME, system=2),
    ],
)
def test_what_is_no_time_of_this_autopilot_tells_nothing(data: bytes) -> None:
    assert time_in(data, system_id=1) is None


def test_a_damaged_message_tells_nothing() -> None:
    data = sent(TIME)
    for place in range(len(data)):
        assert time_in(data[:place] + bytes([data[place] ^ 0x10]) + data[place + 1 :]) is None


@given(st.lists(st.one_of(st.binary(max_size=30), st.sampled_from([b"\xfd\x0c", b"\xfe\x0c", sent(TIME)[:20]]))).map(b"".join))
def test_whatever_arrives_is_no_time_and_no_error(data: bytes) -> None:
    assert time_in(data) is None


@contextmanager
def repeated(data: bytes, send: object) -> Iterator[None]:
    """Have it sent again and again."""
    over = Event()

    def work() -> None:
        while not over.wait(0.02):
            send(data)  # type: ignore[operator]

    sender = Thread(target=work)
    sender.start()
    try:
        yield
    finally:
        over.set()
        sender.join()


def test_on_a_network_it_is_that_of_the_source_and_the_port_is_free_again() -> None:
    port = free_port()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ours:
        with repeated(sent(HEARTBEAT) + sent(TIME), lambda data: ours.sendto(data, ("127.0.0.1", port))):
            address = f"udpin://127.0.0.1:{port}"
            assert asyncio.run(overheard_time(address, None, "127.0.0.1", 5.0)) == UTC_US * 1000
            assert asyncio.run(overheard_time(address, None, "127.0.0.2", 0.1)) is None
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as agent:
            agent.bind(("127.0.0.1", port))
            assert asyncio.run(overheard_time(address, None, None, 0.1)) is None  # in use: reported when it is opened for good


def test_on_a_serial_line() -> None:
    ours, theirs = os.openpty()
    try:
        with repeated(sent(HEARTBEAT, TIME), lambda data: os.write(ours, data)):
            found = asyncio.run(overheard_time(f"serial://{os.ttyname(theirs)}:57600", 1, None, 5.0))
        assert found == UTC_US * 1000
    finally:
        os.close(ours)
        os.close(theirs)
