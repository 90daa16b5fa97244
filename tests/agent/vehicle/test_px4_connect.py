"""Error messages without a reachable vehicle, and no process or port left behind."""

import asyncio
import os
import socket
import time
from functools import partial

import pytest

from radron.agent.config.drone import VehicleConfig
from radron.agent.errors import VehicleError
from radron.agent.vehicle.demands import Demands
from radron.agent.vehicle.interface import Request, VehicleCommand
from radron.agent.vehicle.mavlink.claim import claim_port
from radron.agent.vehicle.px4 import Px4Vehicle


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


async def refusal(address: str, timeout_s: float = 0.5) -> str:
    """The error with which a connection fails, which is one line."""
    vehicle = Px4Vehicle(Demands(VehicleConfig(address=address, connect_timeout_s=timeout_s), 60.0))
    with pytest.raises(VehicleError) as caught:
        await vehicle.connect()
    text = str(caught.value)
    assert "\n" not in text
    assert address in text
    return text


def test_nobody_there_is_told_within_the_configured_time() -> None:
    address = f"udpin://127.0.0.1:{free_port()}"
    begun_s = time.monotonic()
    text = asyncio.run(refusal(address, timeout_s=0.5))
    assert "no autopilot" in text
    assert "0.5 s" in text
    assert time.monotonic() - begun_s < 3.0  # by default 10 s; the machine is shared


@pytest.fixture(autouse=True)
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A port in use is waited for; here not for long."""
    monkeypatch.setattr("radron.agent.vehicle.mavlink.link.claim_port", partial(claim_port, patience_s=0.3))


def test_a_port_in_use_is_told() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        assert "in use" in asyncio.run(refusal(f"udpin://127.0.0.1:{other.getsockname()[1]}"))


def test_a_second_agent_on_the_same_port_is_refused() -> None:
    async def scenario() -> None:
        address = f"udpin://127.0.0.1:{free_port()}"
        first = Px4Vehicle(Demands(VehicleConfig(address=address, connect_timeout_s=5.0), 60.0))
        connecting = asyncio.create_task(first.connect())
        await asyncio.sleep(0)  # listening as soon as it is connecting
        deadline_s = time.monotonic() + 10.0
        while time.monotonic() < deadline_s:
            text = await refusal(address, timeout_s=0.1)
            if "in use" in text:
                break
        connecting.cancel()
        await asyncio.gather(connecting, return_exceptions=True)
        assert "in use" in text

    asyncio.run(scenario())


@pytest.mark.parametrize(
    "address",
    ["nonsense", "udpin://127.0.0.1:99999", "udpin://127.0.0.1:0", "udpin://192.0.2.1:14540", "serial:///dev/none:57600"],
)
def test_addresses_that_cannot_be_opened_are_told(address: str) -> None:
    asyncio.run(refusal(address))


def test_a_failed_connection_leaves_no_thread_and_frees_the_port() -> None:
    threads = len(os.listdir("/proc/self/task"))

    async def scenario() -> None:
        port = free_port()
        await refusal(f"udpin://127.0.0.1:{port}", timeout_s=0.2)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", port))

    asyncio.run(scenario())  # ends the loop's own threads
    deadline_s = time.monotonic() + 10.0
    while len(os.listdir("/proc/self/task")) > threads and time.monotonic() < deadline_s:
        time.sleep(0.02)
    assert len(os.listdir("/proc/self/task")) <= threads


def test_commands_before_a_connection_and_after_the_end_do_nothing() -> None:
    async def scenario() -> None:
        vehicle = Px4Vehicle(Demands(VehicleConfig(address=f"udpin://127.0.0.1:{free_port()}"), 60.0))
        vehicle.command(VehicleCommand(Request.TAKEOFF))
        assert vehicle.problems == ("no heartbeat from the autopilot yet",)
        assert {finding.verdict for finding in await vehicle.findings()} == {"not yet"}
        await vehicle.close()
        await vehicle.close()
        vehicle.command(VehicleCommand(Request.LAND))

    asyncio.run(scenario())
