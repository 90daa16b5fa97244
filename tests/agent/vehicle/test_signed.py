"""MAVLink 2 signatures: an autopilot that signs, and so ignores an agent that does not, is recognised and reported."""

from __future__ import annotations

import asyncio
import os
import socket
import time

import pytest
from pymavlink.dialects.v10 import common as first_version
from pymavlink.dialects.v20 import common as mavlink

from radron.agent.vehicle.mavlink.signed import First, first_message, first_of
from radron.sim.vehicle.px4.mavlink.link import Link
from support.px4.sky import STAY, TAKEOFF, sky

KEY = bytes(range(32))
HEARTBEAT = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, 81, 0, 3, 3)
POSITION = mavlink.MAVLink_local_position_ned_message(1000, 1.0, 2.0, -3.0, 0.0, 0.0, 0.0)


def sign(sender: mavlink.MAVLink) -> None:
    """Have it sign its messages, and take signed messages only, as PX4 does once it has a key."""
    sender.signing.secret_key = KEY
    sender.signing.timestamp = int((time.time() - 1_420_070_400) * 1e5)
    sender.signing.sign_outgoing = True


def sent(*messages: mavlink.MAVLink_message, signs: bool = False, system: int = 1, component: int = 1) -> bytes:
    sender = mavlink.MAVLink(None, system, component)
    if signs:
        sign(sender)
    return b"".join(bytes(message.pack(sender)) for message in messages)


def signed(data: bytes, system_id: int | None = None) -> bool | None:
    first = first_of(data, system_id)
    return None if first is None else first.is_signed


@pytest.mark.parametrize("signs", [True, False])
def test_a_signature_is_seen_wherever_the_bytes_begin(signs: bool) -> None:
    data = sent(HEARTBEAT, POSITION, HEARTBEAT, POSITION, signs=signs)
    assert signed(data) is signs
    for begin in range(40):
        assert signed(data[begin:]) is signs
    assert signed(sent(HEARTBEAT, signs=signs)[:-1]) is None


def test_messages_of_others_and_what_is_no_message_tell_nothing() -> None:
    others = sent(HEARTBEAT, signs=True, component=190)
    assert signed(others) is None
    assert signed(others + sent(HEARTBEAT)) is False
    assert signed(sent(HEARTBEAT, signs=True, system=2), system_id=1) is None
    assert signed(sent(HEARTBEAT, signs=True, system=2), system_id=2) is True
    old = first_version.MAVLink_heartbeat_message(2, 12, 81, 0, 3, 3).pack(first_version.MAVLink(None, 1, 1))
    assert signed(bytes(old)) is False
    assert signed(b"") is None
    assert signed(bytes(2000)) is None


@pytest.mark.parametrize("signs", [True, False])
def test_a_serial_line_is_looked_at_and_left_as_it_was(signs: bool) -> None:
    async def course() -> First | None:
        ours, theirs = os.openpty()
        name = os.ttyname(theirs)
        looking = asyncio.create_task(first_message(f"serial://{name}:921600", None, None, wait_s=5.0))
        try:
            while not looking.done():
                os.write(ours, sent(HEARTBEAT, POSITION, signs=signs))
                await asyncio.sleep(0.02)
            return await looking
        finally:
            os.close(ours)
            os.close(theirs)

    assert asyncio.run(course()) == First(signs, 1)


@pytest.mark.parametrize("address", ["udpin://127.0.0.1:{port}", "serial:///dev/null:57600", "tcpout://127.0.0.1:1"])
def test_where_nothing_comes_nothing_is_known_and_the_port_is_free_again(address: str) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    assert asyncio.run(first_message(address.format(port=port), None, None, wait_s=0.1)) is None
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", port))


def _told(signs: bool) -> tuple[str, str, bool]:
    """Of an emulated vehicle: its problems, the preflight check's finding, and whether it could be armed."""

    async def course() -> tuple[str, str, bool]:
        async with sky() as flight:
            link: Link = flight.face.links[0]
            if signs:
                sign(link._mavlink)
            await flight.connect()
            # An autopilot that ignores requests sends the origin of its local frame once: perhaps before there is a listener.
            await flight.fly(STAY, lambda: bool(signs or (flight.states and flight.state.healthy)))
            await flight.insist(TAKEOFF)
            finding = next(one for one in await flight.vehicle.findings() if one.name == "autopilot")
            return "; ".join(flight.vehicle.problems), f"{finding.verdict}: {finding.text}", flight.fleet.reports()[0].armed

    return asyncio.run(course())


def test_a_vehicle_that_signs_is_told_in_status_and_preflight_and_obeys_nothing() -> None:
    problems, finding, armed = _told(signs=True)
    assert "the autopilot signs its MAVLink messages and ignores ours" in problems
    assert finding.startswith("failed: udpin://127.0.0.1:")
    assert "remove mavlink/mavlink-signing-key.bin from its SD card" in finding
    assert not armed


def test_a_vehicle_that_does_not_sign_is_obeyed_and_the_preflight_check_says_so() -> None:
    problems, finding, armed = _told(signs=False)
    assert "signs" not in problems
    assert finding.startswith("ok: ")
    assert finding.endswith(", its messages are not signed")
    assert armed
