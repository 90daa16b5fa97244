"""The doctor over SSH, as far as it goes without systemd: computers without an agent, and answers that are no report."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from radron.agent.doctor.report import Check, Report
from radron.deploy.computer.doctor import BENCH, examine, report_in
from radron.deploy.remote import Host, RemoteError
from support.computers.sshserver import LACKING, ssh_server
from support.live.agents import Vehicles, closing, free_ports, write_configs
from support.sensors.bench_camera import bench_camera

REPORT = Report(drone="d1", version="0.1.0", mission="yard", stamp_ns=0, checks=(Check("clock", "clock", "ok", ""),))
DEPLOY = str(Path(sys.executable).parent / "radron-deploy")


@pytest.fixture
def host(tmp_path: Path) -> Iterator[Host]:
    if LACKING is not None:
        pytest.skip(LACKING)
    with ssh_server(tmp_path / "ssh") as server:
        yield server


@pytest.mark.skipif(Path(BENCH).exists(), reason="radron is installed on this computer")
def test_a_computer_without_an_agent(host: Host) -> None:
    with pytest.raises(RemoteError, match="radron is not installed there: run `radron-deploy install`"):
        asyncio.run(examine(host, ["--json"], print))


def test_a_report_is_found_among_what_was_said() -> None:
    said = f"waiting for: camera\n{msgspec.json.encode(REPORT).decode()}\n"
    assert report_in(said, RemoteError) == REPORT


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        ("", "gave no report; it said: nothing"),
        ("Traceback\nKeyError: 'x'\n", "gave no report; it said: KeyError: 'x'"),
        ('{"drone": "d1"}\n', "its report is of another version of radron"),
        ("{\n", "its report is of another version of radron"),
    ],
)
def test_what_is_no_report(said: str, reason: str) -> None:
    with pytest.raises(RemoteError, match=reason):
        report_in(said, RemoteError)


def test_one_of_host_and_local_is_needed() -> None:
    told = subprocess.run([DEPLOY, "doctor"], capture_output=True, text=True, timeout=60.0, check=False)
    assert (told.returncode, told.stderr) == (2, "radron-deploy: HOST or --local: give one of them\n")


@pytest.mark.slow
def test_this_computer_with_a_camera_and_an_emulated_vehicle_whose_parameters_are_wrong(tmp_path: Path) -> None:
    ports, camera = write_configs(tmp_path, 1, connect_timeout_s=60.0), free_ports(1)[0]
    with (tmp_path / "d1.toml").open("a") as file:
        file.write(f'[detector]\ndriver = "feed"\naddress = "127.0.0.1:{camera}"\n')
    command = [DEPLOY, "doctor", "--local", "--config", str(tmp_path / "d1.toml"), "--wait", "120"]
    environment = {**os.environ, "COLUMNS": "250"}

    def doctor(*options: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([*command, *options], capture_output=True, text=True, check=False, env=environment)

    vehicles = Vehicles(ports, parameters={"GF_ACTION": 1.0, "COM_OF_LOSS_T": 5.0, "RTL_DESCEND_ALT": 90.0})
    with closing(vehicles), bench_camera(camera):
        wrong = doctor()
        mended = doctor("--write")
    assert wrong.returncode == 1, wrong.stderr
    failed = {line.split("│")[2].strip() for line in wrong.stdout.splitlines() if "X FAILED" in line}
    assert failed - {"chrony"} == {"GF_ACTION", "COM_OF_LOSS_T", "RTL_DESCEND_ALT"}  # chrony is not everywhere
    assert "before" not in wrong.stdout  # nothing is set without a command
    assert "parameter GF_ACTION: 1 before, 3 now" in mended.stdout
    assert "parameter COM_OF_LOSS_T: 5 before, 1 now" in mended.stdout
    assert "parameter RTL_DESCEND_ALT: 90 before, 10 now" in mended.stdout
    assert "NOT TAKEN" not in mended.stdout
    assert "PX4 1.17.0" in mended.stdout
    assert "sees background: " in mended.stdout
    assert mended.stdout.rstrip().splitlines()[-1] in ("+ ready", "X NOT READY: chrony")
