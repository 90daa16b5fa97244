"""Mistakes of a user end ``radron-agent run`` in one line and exit code 2 within 10 s, for a vehicle's port that is in use
after 10 s more; the process ends on request.
"""

import os
import signal
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from radron.agent.vehicle.mavlink.claim import PATIENCE_S
from support.live.agents import Agent, until, write_configs

LIMIT_S = 30.0  # 10 s on a machine that has nothing else to do
STOPPED_S = 5.0  # likewise 2 s
RunAgent = Callable[..., Agent]


@pytest.fixture
def agent(tmp_path: Path) -> Iterator[RunAgent]:
    """Starts agents of the files in ``tmp_path``."""
    agents: list[Agent] = []

    def run(name: str = "d1", **environment: str) -> Agent:
        agents.append(Agent(tmp_path, name, **environment))
        return agents[-1]

    yield run
    for each in agents:
        each.close()


def refusal(agent: Agent, limit_s: float = LIMIT_S) -> str:
    """The last line; other lines belong to its log."""
    assert agent.ended(limit_s) == 2
    (line,) = (line for line in agent.log.splitlines() if not line.startswith("{"))
    return line


@pytest.mark.slow
def test_no_vehicle(tmp_path: Path, agent: RunAgent) -> None:
    (port,) = write_configs(tmp_path, 1)
    line = refusal(agent())
    assert line.startswith(f"radron-agent: no autopilot on udpin://127.0.0.1:{port} within 5 s")


@pytest.mark.slow
def test_the_vehicles_port_is_in_use(tmp_path: Path, agent: RunAgent) -> None:
    (port,) = write_configs(tmp_path, 1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", port))
        line = refusal(agent(), PATIENCE_S + LIMIT_S)
    assert f"127.0.0.1:{port}" in line
    assert "in use" in line
    assert f"process {os.getpid()}" in line


def test_the_meshs_port_is_in_use(tmp_path: Path, agent: RunAgent) -> None:
    write_configs(tmp_path, 1)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        endpoint = f"tls/127.0.0.1:{other.getsockname()[1]}"
        line = refusal(agent(RADRON_MESH__LISTEN=endpoint))
    assert endpoint in line
    assert "in use" in line


def test_a_variable_that_is_no_key(tmp_path: Path, agent: RunAgent) -> None:
    write_configs(tmp_path, 1)
    assert "RADRON_VEHICLE__PORT: unknown key 'vehicle.port'" in refusal(agent(RADRON_VEHICLE__PORT="14540"))


def test_it_ends_when_asked_to_while_it_waits_for_its_vehicle(tmp_path: Path, agent: RunAgent) -> None:
    write_configs(tmp_path, 1)
    waiting = agent()
    until(lambda: "mesh is up" in waiting.log, LIMIT_S, "the mesh")
    asked_s = time.monotonic()
    waiting.process.send_signal(signal.SIGINT)
    assert waiting.ended(LIMIT_S) == 0
    assert time.monotonic() - asked_s < STOPPED_S


def test_it_ends_when_asked_to_before_it_is_up(tmp_path: Path, agent: RunAgent) -> None:
    write_configs(tmp_path, 1)
    starting = agent()
    assert starting.child
    starting.process.terminate()
    assert starting.ended(STOPPED_S) == 0
