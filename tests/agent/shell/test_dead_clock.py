"""An agent whose computer has a dead clock waits, listens for the autopilot's time, and hands it over; the link is free again."""

from __future__ import annotations

import socket
import time
from pathlib import Path

import pytest

from radron.agent.clock.handover import TIME_FILE, Valid, taken
from radron.agent.clock.seeking import seek_time
from radron.agent.config.drone import VehicleConfig
from radron.agent.shell import running
from radron.agent.shell.heartbeat import Heartbeat
from radron.agent.shell.identity import DeadClockError, check_clock
from radron.agent.shell.overrides import load_drone
from radron.agent.shell.patience import Patience
from radron.agent.shell.running import run_agent
from support.computers.fleets import MISSION
from support.mesh.identities import DAY_NS, identity, new_issuer
from support.mesh.meshes import free_port
from support.px4.time_source import telling

PORT = free_port()


@pytest.fixture
def drone_file(tmp_path: Path) -> Path:
    """The file of a drone whose certificate begins tomorrow."""
    identity(new_issuer("radron"), tmp_path, "d1", from_ns=DAY_NS + DAY_NS // 2)
    (tmp_path / "mission.toml").write_text(MISSION)
    (tmp_path / "told").mkdir()
    file = tmp_path / "drone.toml"
    file.write_text(
        f'id = "d1"\nmission = "mission.toml"\n[mesh]\nidentity = "d1"\n[vehicle]\naddress = "udpin://127.0.0.1:{PORT}"\n'
    )
    return file


def waits(drone_file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> str:
    """The reported reasons for waiting."""

    def sleep(_: float) -> None:
        raise InterruptedError  # the test's end

    monkeypatch.setattr(running.time, "sleep", sleep)
    with pytest.raises(InterruptedError):
        run_agent(str(drone_file), False, Heartbeat(), patience=Patience(Heartbeat(), waits=True))
    said = capsys.readouterr().err
    assert said.startswith("radron-agent: waiting: clock: ")
    assert "not valid before" in said
    return said


def test_what_the_autopilot_tells_is_handed_over_and_told(
    drone_file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = drone_file.parent / "told"
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(folder))
    with telling(PORT, lambda: 1_000_000_000_000_000_000):
        said = waits(drone_file, monkeypatch, capsys)
    assert "; the autopilot's clock, 2001-09-09 01:46 UTC, cannot be right either" in said
    assert list(folder.iterdir()) == []
    utc_ns = (time.time_ns() + 3 * DAY_NS) // 1000 * 1000
    with telling(PORT, lambda: utc_ns):
        assert "; it is set by the autopilot's, 20" in waits(drone_file, monkeypatch, capsys)
    told = taken(folder / TIME_FILE)
    assert told is not None
    assert told.utc_ns == utc_ns
    assert 0.0 <= time.monotonic() - told.uptime_s < 60.0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind(("127.0.0.1", PORT))


def test_without_a_computer_that_would_set_it_nothing_is_listened_to(
    drone_file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("RUNTIME_DIRECTORY", raising=False)
    assert "autopilot" not in waits(drone_file, monkeypatch, capsys)


def test_an_autopilot_that_tells_no_time_is_told(tmp_path: Path) -> None:
    valid = Valid(time.time_ns(), time.time_ns() + DAY_NS)
    said = seek_time(VehicleConfig(address=f"udpin://127.0.0.1:{free_port()}"), valid, tmp_path, wait_s=0.05)
    assert "tells no time yet: it has it from satellites or a ground station" in said


def test_where_anybody_could_tell_a_time_none_is_taken(tmp_path: Path) -> None:
    valid = Valid(time.time_ns(), time.time_ns() + DAY_NS)
    said = seek_time(VehicleConfig(address=f"udpin://192.0.2.1:{free_port()}"), valid, tmp_path, wait_s=60.0)
    assert said.endswith("where anybody could tell it: set vehicle.source to the autopilot's address")


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    port, now_ns = free_port(), time.time_ns()
    vehicle, valid = VehicleConfig(address=f"udpin://127.0.0.1:{port}"), Valid(now_ns, now_ns + 3 * DAY_NS)
    with telling(port, lambda: now_ns + DAY_NS):
        said = seek_time(vehicle, valid, tmp_path / "missing", wait_s=60.0)
    assert said.endswith(f"cannot be handed over ({tmp_path / 'missing'}: No such file or directory)")


def test_software_from_after_now_is_a_sign_of_a_dead_clock_too(drone_file: Path) -> None:
    drone, _ = load_drone(drone_file, {})
    now_ns = time.time_ns() + 3 * DAY_NS
    check_clock(drone, now_ns, now_ns - 1)
    with pytest.raises(DeadClockError, match=r"clock: this release was made at .*, and this computer's clock shows ") as dead:
        check_clock(drone, now_ns, now_ns + DAY_NS)
    assert dead.value.valid.begin_ns == now_ns + DAY_NS
