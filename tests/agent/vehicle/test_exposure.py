"""MAVLink from elsewhere: the report to the operator on a link, and packets that are taken from the vehicle only."""

from __future__ import annotations

import asyncio
import socket
import threading

import pytest
from pymavlink.dialects.v20 import common as mavlink

from radron.agent.config.drone import VehicleConfig
from radron.agent.errors import VehicleError
from radron.agent.vehicle.demands import Demands
from radron.agent.vehicle.mavlink.exposure import exposure, take_only_from
from radron.agent.vehicle.px4 import Px4Vehicle
from support.px4.sky import STAY, free_port, sky


@pytest.mark.parametrize(
    "address", ["serial:///dev/ttyTHS1:921600", "udpin://127.0.0.1:14540", "udp://localhost:14540", "tcpout://127.0.0.2:5760"]
)
def test_a_serial_line_and_a_loopback_are_nobody_elses(address: str) -> None:
    assert exposure(address) is None


@pytest.mark.parametrize(
    "address", ["udpin://0.0.0.0:14540", "udpin://10.41.10.1:14540", "tcpout://10.41.10.2:5760", "udp://:14540"]
)
def test_any_other_link_is_told(address: str) -> None:
    told = exposure(address)
    assert told is not None
    assert f"MAVLink at {address} is neither loopback nor serial, packets are taken from everybody" in told
    assert "packets only from 10.41.10.2" in str(exposure(address, "10.41.10.2"))


def test_by_default_an_agent_listens_where_nobody_else_is() -> None:
    assert exposure(VehicleConfig().address) is None


def _taken(link: socket.socket, sender: str) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as source:
        source.bind((sender, 0))
        source.sendto(sender.encode(), link.getsockname())
    try:
        return link.recv(100) == sender.encode()
    except TimeoutError:
        return False


def test_packets_from_another_address_are_dropped_by_the_kernel() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind(("127.0.0.1", 0))
        link.settimeout(0.2)
        assert _taken(link, "127.0.0.2")
        assert _taken(link, "127.0.0.3")
        take_only_from(f"udpin://127.0.0.1:{link.getsockname()[1]}", "127.0.0.2")
        assert not _taken(link, "127.0.0.3")
        assert _taken(link, "127.0.0.2")


@pytest.mark.parametrize(
    ("address", "source", "text"),
    [
        ("serial:///dev/ttyTHS1:921600", "127.0.0.1", "is not a UDP link; remove vehicle.source"),
        ("udpin://127.0.0.1:1", "vehicle", "'vehicle' is not an IPv4 address, such as"),
        ("udpin://127.0.0.1:1", "127.0.0.1", "the socket of udpin://127.0.0.1:1 is not found"),
    ],
)
def test_a_source_that_cannot_be_kept_to_is_refused(address: str, source: str, text: str) -> None:
    with pytest.raises(VehicleError, match=text):
        take_only_from(address, source)


def _forge(port: int, sender: str, system: int, ended: threading.Event) -> None:
    """Send as an autopilot that is armed, 900 m away, as often as this computer can."""
    heartbeat = mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_PX4, 209, 0x3040000, 4, 3)
    position = mavlink.MAVLink_local_position_ned_message(0, 900.0, 0.0, -3.0, 0.0, 0.0, 0.0)
    packets = [message.pack(mavlink.MAVLink(None, system, 1)) for message in (heartbeat, position)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as source:
        source.bind((sender, 0))
        while not ended.wait(0.0002):
            for packet in packets:
                source.sendto(packet, ("127.0.0.1", port))


@pytest.mark.parametrize(
    ("sender", "system", "settings", "disturbed"),
    [
        ("127.0.0.2", 1, {}, True),  # the attack, and twin of all others: on a loopback everybody is taken
        ("127.0.0.2", 7, {"source": "127.0.0.1"}, False),
        ("127.0.0.1", 7, {"system_id": 1}, False),
    ],
    ids=["taken from everybody", "another address and system", "another system"],
)
def test_a_vehicle_is_flown_whatever_others_send_also_before_it_is_known(
    sender: str, system: int, settings: dict[str, object], disturbed: bool
) -> None:
    async def course() -> bool:
        async with sky(**settings) as flight:
            ended = threading.Event()
            port = int(flight.address.rpartition(":")[2])
            forging = asyncio.create_task(asyncio.to_thread(_forge, port, sender, system, ended))
            try:
                await flight.connect()
                if disturbed:
                    await flight.wait(10.0, STAY)
                else:
                    await flight.fly(STAY, lambda: len(flight.states) > 10 and flight.state.healthy, timeout_s=60.0)
                return len(flight.states) > 10 and flight.state.healthy
            finally:
                ended.set()
                await forging

    assert asyncio.run(course()) is not disturbed


def test_on_an_open_network_the_first_vehicles_address_is_kept_to() -> None:
    async def course() -> tuple[bool, str]:
        port = free_port()
        async with sky(address=f"udpin://0.0.0.0:{port}", onboard_port=port) as flight:
            assert "from everybody" in str(flight.vehicle.exposure)
            await flight.connect()
            ended = threading.Event()
            forging = asyncio.create_task(asyncio.to_thread(_forge, port, "127.0.0.2", 1, ended))
            try:
                await flight.fly(STAY, lambda: len(flight.states) > 10 and flight.state.healthy, timeout_s=60.0)
                return flight.state.healthy, str(flight.vehicle.exposure)
            finally:
                ended.set()
                await forging

    healthy, told = asyncio.run(course())
    assert healthy
    assert "packets only from 127.0.0.1, whose vehicle was heard first (vehicle.source is not set)" in told


def test_without_the_vehicle_nobody_else_is_taken_for_it() -> None:
    address, ended = f"udpin://127.0.0.1:{free_port()}", threading.Event()

    async def course() -> None:
        forging = asyncio.create_task(asyncio.to_thread(_forge, int(address.rpartition(":")[2]), "127.0.0.2", 1, ended))
        vehicle = Px4Vehicle(Demands(VehicleConfig(address=address, source="127.0.0.1", connect_timeout_s=0.5), 60.0))
        try:
            with pytest.raises(VehicleError, match=rf"no autopilot on {address} from 127\.0\.0\.1 within 0\.5 s; is it powered"):
                await vehicle.connect()
        finally:
            ended.set()
            await forging

    asyncio.run(course())
