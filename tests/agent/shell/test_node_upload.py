"""A mission uploaded to real agents with emulated vehicles: taken by all or refused with a reason, kept over restarts, and
flown.
"""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from radron.agent.config.loading import load_mission
from radron.agent.flight.audit import audit, mission_of
from radron.agent.flight.reader import RecordedFlight
from support.live.agents import Agent, Vehicles, closing, command, operator_folder, station_endpoint, until, write_configs

BUSY_S = 30.0  # by which everything may take longer on a busy computer
pytestmark = pytest.mark.slow


def upload(folder: Path, mission: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """``radron-agent upload`` to the swarm of these files."""
    tool = str(Path(sys.executable).parent / "radron-agent")
    links = ("--connect", station_endpoint(folder), "--identity", str(operator_folder(folder)))
    return subprocess.run(
        [tool, "upload", str(mission), *links, *options], capture_output=True, text=True, timeout=150.0, check=False
    )


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    with closing(Vehicles(write_configs(tmp_path, 2))):
        (tmp_path / "new.toml").write_text((tmp_path / "mission.toml").read_text().replace('"test"', '"new"'))
        yield tmp_path


def ready(folder: Path, *agents: Agent) -> None:
    """Wait until all have telemetry of their vehicles, as an operator sees."""
    until(lambda: all(of(agent, "vehicle is connected") for agent in agents), 20.0 + BUSY_S, "connected")
    until(lambda: (said := statuses(folder)).count("preflight") == len(agents) and "telemetry" not in said, 60.0, "telemetry")


def statuses(folder: Path) -> str:
    """The output of ``radron-agent status``."""
    tool = str(Path(sys.executable).parent / "radron-agent")
    links = ("--swarm", "radron", "--connect", station_endpoint(folder), "--identity", str(operator_folder(folder)))
    ran = subprocess.run([tool, "status", *links], capture_output=True, text=True, timeout=60.0, check=False)
    return ran.stdout


def of(agent: Agent, event: str) -> list[dict[str, Any]]:
    return [line for line in agent.events() if line.get("event") == event]


def missions(agent: Agent) -> list[str]:
    """Of each start of the agent."""
    return [line["mission"] for line in of(agent, "mesh is up")]


def test_a_mission_is_taken_by_all_kept_over_a_restart_and_started(folder: Path) -> None:
    old, new = (load_mission(folder / name).mission_id for name in ("mission.toml", "new.toml"))
    d1, d2 = Agent(folder, "d1"), Agent(folder, "d2")
    with closing(d1, d2):
        ready(folder, d1, d2)
        done = upload(folder, folder / "new.toml")
        assert done.returncode == 0, done.stdout + done.stderr
        assert done.stdout.splitlines()[0] == f"upload: to d1, d2, mission {new}"
        assert {"d1: takes it over", "d2: takes it over", "d1: has it", "d2: has it"} <= set(done.stdout.splitlines())
        assert missions(d1) == missions(d2) == [old, new]
        again = upload(folder, folder / "new.toml")
        assert (again.returncode, again.stdout.splitlines()[1:]) == (0, ["d1: has it already", "d2: has it already"])
        refused = command(folder, "start", "--mission", old)
        assert (refused.returncode, old in refused.stderr, new in refused.stderr) == (2, True, True)
    d1, d2 = Agent(folder, "d1"), Agent(folder, "d2")
    with closing(d1, d2):
        ready(folder, d1, d2)
        assert missions(d1) == missions(d2) == [new]
        until(lambda: command(folder, "start", "--anyway", "--mission", new).returncode == 0, 60.0 + BUSY_S, "start")
        until(lambda: any(line["stage"] == "survey" for line in of(d1, "stage")), 30.0 + BUSY_S, "survey")
        flying = upload(folder, folder / "mission.toml")
        assert flying.returncode == 1
        assert "d1: refused: its mission has begun" in flying.stdout
        assert missions(d1) == [new]
    records = sorted(folder.glob("records/*.mcap"), key=lambda path: path.stat().st_mtime)
    flights = [RecordedFlight(path, whole=False) for path in records]
    flown = [flight for flight in flights if flight.header.mission.mission_id == new]
    assert flown
    assert all(" by operator, operator operator, serial " in mission_of(flight) for flight in flown)
    before = [flight for flight in flights if flight.header.mission.mission_id == old and flight.header.drone.id == "d1"]
    assert [(one.action, one.result) for one in audit(before[0])][:1] == [(f"upload {new}", "taken over")]


def test_a_drone_that_cannot_keep_a_mission_says_why_and_no_start_follows(folder: Path) -> None:
    drone_file = folder / "d2.toml"
    drone_file.write_text(drone_file.read_text().replace('state = "state"\n', ""))
    old, new = (load_mission(folder / name).mission_id for name in ("mission.toml", "new.toml"))
    d1, d2 = Agent(folder, "d1"), Agent(folder, "d2")
    with closing(d1, d2):
        ready(folder, d1, d2)
        partly = upload(folder, folder / "new.toml")
        assert partly.returncode == 1, partly.stdout + partly.stderr
        said = partly.stdout.splitlines()
        assert 'd2: refused: no folder to keep it: give one in the drone file (state = "state")' in said
        assert "d1: has it" in said
        assert said[-1] == "upload: d2 kept another mission, d1 took it: no start until all have the same"
        refused = command(folder, "start")
        assert refused.returncode == 2
        assert f"the drones have different missions (d1: {new}; d2: {old})" in refused.stderr
        assert missions(d2) == [old]
