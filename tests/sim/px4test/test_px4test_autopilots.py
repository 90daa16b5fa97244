"""Start and end of a real PX4's instances for a flight test, with a stand-in for its binary."""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import signal
import stat
import subprocess
import sysconfig
from pathlib import Path
from typing import Any

import psutil
import pymap3d
import pytest

from radron.agent.errors import VehicleError
from radron.sim.live.runfolder import live_mission
from radron.sim.live.worldprocess import LiveError
from radron.sim.px4test.autopilots import autopilots, variables_of
from radron.sim.px4test.px4 import Px4
from radron.sim.px4test.session import SESSIONS
from radron.sim.scenario import load_scenario
from radron.sim.vehicle.px4.config import Datum
from radron.sim.vehicle.px4.parameters import DEFAULTS
from support.live.agents import until
from support.px4.ports import px4_ports

STANDIN = Path(__file__).parents[2] / "lib/support/px4/standin.py"
MISSION = live_mission(load_scenario("paper-demo"), 1)
PROGRAM = Path(sysconfig.get_path("scripts")) / "radron-sim"


@pytest.fixture
def build(tmp_path: Path) -> Path:
    """A folder as PX4's build has it; the binary in it."""
    binary = tmp_path / "build" / "bin" / "px4"
    binary.parent.mkdir(parents=True)
    (tmp_path / "build" / "etc").mkdir()
    shutil.copy(STANDIN, binary)
    binary.chmod(binary.stat().st_mode | stat.S_IXUSR)
    return binary


def called(folder: Path, instance: int) -> dict[str, Any]:
    """An instance's notes on its start."""
    note: dict[str, Any] = json.loads((folder / f"px4-{instance}" / "called.json").read_text())
    return note


def runs(pid: int) -> bool:
    return psutil.pid_exists(pid) and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE


def test_an_instance_for_each_drone_at_its_launch_place_with_what_a_crew_sets(build: Path, tmp_path: Path) -> None:
    px4 = Px4.found({"PX4_BIN": str(build)})
    assert px4 is not None
    pids = []

    async def course() -> None:
        with px4_ports():
            await start_and_end()

    async def start_and_end() -> None:
        async with autopilots(px4, MISSION, tmp_path) as places:
            assert [port for _, port in places.onboard] == [14540, 14541, 14542]
            assert places.ground_station == ("127.0.0.1", 14550)
            assert places.agents_here
            assert len(set(places.mesh)) == 3
            pids.extend(called(tmp_path, instance)["pid"] for instance in range(3))
            assert all(runs(pid) for pid in pids)

    asyncio.run(course())
    assert not any(runs(pid) for pid in pids)
    for instance, drone in enumerate(MISSION.drones):
        note = called(tmp_path, instance)
        assert note["arguments"] == ["-d", "-i", str(instance), str(build.parents[1] / "etc")]
        assert note["folder"] == str(tmp_path / f"px4-{instance}")
        environment = note["environment"]
        assert (environment["PX4_SIM_MODEL"], environment["PX4_SYS_AUTOSTART"]) == ("sihsim_quadx", "10040")
        datum = Datum()
        home = [float(environment[f"PX4_HOME_{name}"]) for name in ("LAT", "LON", "ALT")]
        place = pymap3d.geodetic2enu(*home, datum.latitude_deg, datum.longitude_deg, datum.altitude_m)
        assert place == pytest.approx(drone.origin_m, abs=0.01)
        assert "PX4 says something" in (tmp_path / f"px4-{instance}" / "px4.log").read_text()


def test_what_is_set_is_what_preflight_asks_for_and_integers_are_written_as_such() -> None:
    variables = variables_of(MISSION, MISSION.drones[0].origin_m)
    parameters = {name.removeprefix("PX4_PARAM_"): value for name, value in variables.items() if name.startswith("PX4_PARAM_")}
    assert set(parameters) >= {"COM_OBL_RC_ACT", "RTL_RETURN_ALT", "RTL_DESCEND_ALT", "GF_ACTION", "GF_MAX_HOR_DIST"}
    assert int(parameters["COM_OBL_RC_ACT"]) == 3
    assert int(parameters["EKF2_NOAID_TOUT"]) <= 2_000_000
    assert float(parameters["RTL_RETURN_ALT"]) < MISSION.area.ceiling_m
    for name, value in parameters.items():  # PX4's `param set` takes no 2e+06 for an integer
        assert type(DEFAULTS[name])(value) == float(value), name


def test_an_instance_that_ends_at_once_is_told_with_its_last_words(
    build: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PX4_STANDIN_ENDS", "3")

    async def course() -> None:
        async with autopilots(Px4(binary=build), MISSION, tmp_path):
            pass

    with pytest.raises(LiveError, match=r"PX4 0 ended with code 3: ERROR \[px4\] Startup script returned"):
        asyncio.run(course())


def test_an_image_gets_the_same_by_docker() -> None:
    variables = variables_of(MISSION, MISSION.drones[2].origin_m)
    words = Px4(image="px4io/px4-sitl:v1.17.0").command(2, variables)
    assert words[:6] == ["docker", "run", "--rm", "--init", "--network", "host"]
    assert {f"{name}={value}" for name, value in variables.items()} == {
        words[place + 1] for place, word in enumerate(words) if word == "--env"
    }
    assert words[-5:] == ["/opt/px4/bin/px4", "px4io/px4-sitl:v1.17.0", "-d", "-i", "2"]


def test_what_is_named_but_not_there_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(VehicleError, match=r"PX4_BIN: .*px4 is no program"):
        Px4.found({"PX4_BIN": str(tmp_path / "px4")})
    assert Px4.found({}) is None


def command(folder: Path, **environment: str) -> subprocess.Popen[str]:
    rest = {name: value for name, value in os.environ.items() if not name.startswith("PX4_")}
    return subprocess.Popen(
        [PROGRAM, "px4-test", "--out", folder / "out"],
        env=rest | environment, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip


def test_without_a_px4_it_is_skipped(tmp_path: Path) -> None:
    process = command(tmp_path)
    _, said = process.communicate(timeout=30.0)
    assert process.returncode == 77
    assert said.startswith("SKIPPED: no real PX4")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_instances_end_with_the_command_however_that_ends(build: Path, tmp_path: Path) -> None:
    with px4_ports():
        ended_by(signal.SIGINT, 128 + signal.SIGINT, build, tmp_path / "interrupted")
        ended_by(signal.SIGKILL, -signal.SIGKILL, build, tmp_path / "killed")


def ended_by(number: signal.Signals, code: int, build: Path, folder: Path) -> None:
    first = folder / "out" / next(iter(SESSIONS))
    folder.mkdir()
    process = command(folder, PX4_BIN=str(build))
    try:
        until(lambda: process.poll() is not None or (first / "world.json").exists(), 60.0)
        pids = [called(first, instance)["pid"] for instance in range(3)]
        process.send_signal(number)
        process.communicate(timeout=15.0)
        assert process.returncode == code
        until(lambda: not any(runs(pid) for pid in pids), 5.0)
    finally:
        process.kill()
        process.communicate()
