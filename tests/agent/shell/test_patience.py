"""Waiting for missing parts before a flight: reported once, tried again, and none of this without ``--wait``."""

from __future__ import annotations

import asyncio
import os
import time
from itertools import groupby
from pathlib import Path

import pytest

from radron.agent.config.drone import DroneConfig, PeerMeshConfig
from radron.agent.errors import ConfigError, VehicleError
from radron.agent.shell import running
from radron.agent.shell.heartbeat import Heartbeat
from radron.agent.shell.identity import check_clock
from radron.agent.shell.patience import Patience
from radron.agent.shell.running import USER_ERROR, run_agent
from support.mesh.identities import identity, new_issuer


class Obstacle:
    """An attempt that fails with each of these errors, and then succeeds."""

    def __init__(self, *errors: Exception) -> None:
        self._errors = list(errors)
        self.attempts = 0

    async def __call__(self) -> None:
        self.attempts += 1
        if self._errors:
            raise self._errors.pop(0)


def test_what_is_waited_for_is_told_once_and_to_the_service_manager(capsys: pytest.CaptureFixture[str]) -> None:
    reading, writing = os.pipe()
    patience = Patience(Heartbeat(writing), waits=True, retry_s=0.001)
    attempt = Obstacle(VehicleError("no autopilot"), VehicleError("no autopilot"), ConfigError("no mission"))
    asyncio.run(patience.until(attempt))
    assert attempt.attempts == 4
    assert capsys.readouterr().err == "radron-agent: waiting: no autopilot\nradron-agent: waiting: no mission\n"
    told = os.read(reading, 4096).decode().splitlines()  # repeated, by which the supervisor sees that it lives
    assert [line for line, _ in groupby(told)] == ["STATUS=waiting: no autopilot", "STATUS=waiting: no mission"]
    assert len(told) >= attempt.attempts - 1
    os.close(reading)
    os.close(writing)


def test_without_patience_the_first_obstacle_is_the_end() -> None:
    attempt = Obstacle(VehicleError("no autopilot"))
    with pytest.raises(VehicleError, match="no autopilot"):
        asyncio.run(Patience(Heartbeat()).until(attempt))
    assert attempt.attempts == 1


def test_other_exceptions_are_never_waited_for() -> None:
    with pytest.raises(ZeroDivisionError):
        asyncio.run(Patience(Heartbeat(), waits=True).until(Obstacle(ZeroDivisionError())))


def test_an_agent_waits_for_its_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = str(tmp_path / "drone.toml")
    assert run_agent(missing, False, Heartbeat()) == USER_ERROR
    capsys.readouterr()

    slept: list[float] = []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        if len(slept) == 3:
            raise InterruptedError  # the test's end

    monkeypatch.setattr(running.time, "sleep", sleep)
    with pytest.raises(InterruptedError):
        run_agent(missing, False, Heartbeat(), patience=Patience(Heartbeat(), waits=True, retry_s=2.0))
    assert slept == [2.0, 2.0, 2.0]
    assert capsys.readouterr().err == f"radron-agent: waiting: {missing}: cannot be read: No such file or directory\n"


def test_a_clock_before_the_certificate_is_an_obstacle(tmp_path: Path) -> None:
    identity(new_issuer(), tmp_path, "d1")
    drone = DroneConfig(id="d1", mesh=PeerMeshConfig(identity=str(tmp_path / "d1")))
    check_clock(drone, time.time_ns() + 60_000_000_000)
    with pytest.raises(ConfigError, match=r"clock: .*not valid before .*this computer's clock shows 2000-01-01 00:00"):
        check_clock(drone, 946_684_800_000_000_000)
