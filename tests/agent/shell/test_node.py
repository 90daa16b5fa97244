"""The agent as a process with its vehicle: its error messages, its preflight check, and its end in flight."""

import asyncio
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from radron.protocol.codec import decode
from radron.protocol.identity import load_identity
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.messages import Status
from support.live.agents import (
    Agent,
    Vehicles,
    closing,
    command,
    free_ports,
    operator_folder,
    station_endpoint,
    until,
    write_configs,
)

SAID_S = 10.0  # limit for the report of a fault
BUSY_S = 15.0  # additional time for everything on a busy computer


@pytest.fixture
def vehicles(tmp_path: Path) -> Iterator[Vehicles]:
    """Two vehicles, the second never healthy, and files for their agents."""
    vehicles = Vehicles(write_configs(tmp_path, 2), {1: "Preflight Fail: compass 0 uncalibrated"})
    with closing(vehicles):
        yield vehicles


def problems_of(folder: Path, drone: str, *expected: str, connect: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Wait until a drone's status names all these problems. ``connect``: further endpoints to dial."""
    statuses: list[Status] = []

    def receive(key: str, payload: bytes) -> None:
        message = decode(payload)
        if isinstance(message, Status) and message.drone == drone:
            statuses.append(message)

    def told() -> bool:
        return bool(statuses) and all(any(part in text for text in statuses[-1].problems) for part in expected)

    async def listen() -> None:
        links = MeshConfig(connect=(station_endpoint(folder, drone), *connect), identity=load_identity(operator_folder(folder)))
        mesh = await Mesh.open(links, "radron", None, receive=receive)
        try:
            deadline_s = time.monotonic() + SAID_S + BUSY_S
            while not told():
                assert time.monotonic() < deadline_s, f"{expected} not in {statuses[-1:]}"
                await asyncio.sleep(0.05)
        finally:
            await mesh.close()

    asyncio.run(listen())
    return statuses[-1].problems


def preflight(folder: Path, drone: str) -> subprocess.CompletedProcess[str]:
    tool = str(Path(sys.executable).parent / "radron-agent")
    return subprocess.run(
        [tool, "preflight", "--config", str(folder / f"{drone}.toml"), "--wait", "12"],
        capture_output=True, text=True, timeout=60.0, check=False, env={**os.environ, "COLUMNS": "200"},
    )  # fmt: skip


@pytest.mark.slow
def test_what_is_wrong_is_in_the_status_and_stands_against_a_start(tmp_path: Path, vehicles: Vehicles) -> None:
    d2 = Agent(tmp_path, "d2")
    with closing(d2):
        problems_of(tmp_path, "d2", "not ready to arm", "no contact with d1 (tls/127.0.0.1:")
        refused = command(tmp_path, "start", "--drones", "d2", "--connect", station_endpoint(tmp_path, "d2"))
        assert refused.returncode == 2
        assert "not ready to arm" in refused.stderr
        assert not vehicles.now(1)["armed"]


@pytest.mark.slow
def test_links_that_are_not_encrypted_show_in_the_status(tmp_path: Path, vehicles: Vehicles) -> None:
    file = tmp_path / "d1.toml"
    file.write_text(file.read_text().replace('identity = "identity/d1"', "insecure = true").replace("tls/", "tcp/"))
    tool, links = str(Path(sys.executable).parent / "radron-agent"), ("--connect", station_endpoint(tmp_path), "--insecure")

    def status() -> str:
        told = subprocess.run(
            [tool, "status", "--swarm", "radron", *links],
            capture_output=True, text=True, timeout=60.0, check=False, env={**os.environ, "COLUMNS": "500"},
        )  # fmt: skip
        return told.stdout

    with closing(Agent(tmp_path, "d1")):
        until(lambda: "links are not encrypted (mesh.insecure = true)" in status(), SAID_S + BUSY_S, "the notice")


@pytest.mark.slow
def test_two_agents_with_one_id_both_say_so(tmp_path: Path, vehicles: Vehicles) -> None:
    first = Agent(tmp_path, "d1")
    listen = f"tls/127.0.0.1:{free_ports(1)[0]}"
    twin = Agent(tmp_path, "d2", RADRON_ID="d1", RADRON_MESH__LISTEN=listen, RADRON_MESH__IDENTITY="identity/d1")
    with closing(first, twin):
        problems_of(tmp_path, "d1", "another agent is running as d1", connect=(listen,))


@pytest.mark.slow
def test_preflight_and_a_clean_end_in_flight(tmp_path: Path, vehicles: Vehicles) -> None:
    (tmp_path / "mission.toml").write_text(
        (tmp_path / "mission.toml").read_text().replace(', { id = "d2", origin_m = [11, 5, 0] }', "")
    )
    ready = preflight(tmp_path, "d1")
    assert "not yet" not in ready.stdout
    assert ready.stdout.count("failed") == 1  # no camera is configured
    assert ready.returncode == 1
    d1 = Agent(tmp_path, "d1")
    with closing(d1):
        until(lambda: command(tmp_path, "start", "--anyway").returncode == 0, SAID_S + BUSY_S, "a start that is obeyed")
        until(lambda: vehicles.now(0)["mode"] == "offboard", 20.0 + BUSY_S, "offboard")
        for action, mode in (("hold", "hold"), ("resume", "offboard")):
            assert command(tmp_path, action).returncode == 0
            until(lambda mode=mode: vehicles.now(0)["mode"] == mode, 5.0 + BUSY_S, mode)
        asked_s = time.monotonic()
        d1.process.terminate()
        assert d1.ended(BUSY_S) == 0
        assert time.monotonic() - asked_s < 2.0 + 3.0  # the machine is shared
        until(lambda: vehicles.now(0)["mode"] == "return", 3.0 + BUSY_S, "the vehicle's own way home")
        assert [event["stage"] for event in d1.events() if event["event"] == "stage"] == [
            "preflight", "takeoff", "survey", "hold", "survey",
        ]  # fmt: skip
