"""MAVLink from elsewhere: what an operator is told of a link, and packets that are taken from the vehicle only."""

from __future__ import annotations

import socket

import pytest

from agent.config.drone import VehicleConfig
from agent.errors import VehicleError
from agent.vehicle.exposure import exposure, take_only_from


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
