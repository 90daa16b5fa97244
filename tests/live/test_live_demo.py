"""A whole flight of three real agents, from the first process to the last."""

from __future__ import annotations

import base64
import json
from glob import glob
from pathlib import Path
from shutil import which

import pytest

from radron.agent.flight.replay import replay
from radron.sim.live.world import SLIP_S
from radron.sim.result import RunResult
from radron.station.replay import Records
from support.live.run import live_run
from support.mesh.identities import private_key

FLIGHT_S = 300.0  # 60 s of it are flown; the machine is shared


@pytest.mark.slow
def test_three_agents_find_the_source_agree_and_leave_nothing_behind(tmp_path: Path) -> None:
    options = ("--seed", "1", "--set", "mission.track.duration_s=12", "--json", str(tmp_path / "run.json"))
    with live_run(tmp_path, "demo", *options) as run:
        run.process.wait(FLIGHT_S)
        assert run.process.returncode == 0, run.said
        run.until(lambda: not run.processes() and not run.busy_ports(), 5.0)
    result = json.loads((tmp_path / "run.json").read_text())
    assert list(result) == list(RunResult.__struct_fields__)
    assert result["time_to_x0_s"] is not None
    assert result["time_to_x0_s"] < 60.0
    assert not result["lost"]
    assert result["error_median_m"] < 10.0
    assert result["fence_breaches"] == 0
    assert result["min_separation_m"] > 2.0  # separation 3 m by estimated positions, less their errors
    report = json.loads((tmp_path / "agents.json").read_text())
    assert result["realtime_factor"] < 1.05
    assert (
        result["realtime_factor"] > 0.7 or report["world_late_s"] > SLIP_S
    )  # on a machine that is too busy it stands still at times
    agents = report["agents"]
    assert report["agreed"], run.said
    assert [agent["stage"] for agent in agents] == ["landed"] * 3
    assert [agent["problems"] for agent in agents] == [[]] * 3  # all can be started again
    assert len({agent["digest"] for agent in agents}) == 1
    assert len({tuple(agent["position_m"]) for agent in agents}) == 1
    assert all(agent["computed_setpoints"] > 100 for agent in agents)
    assert (tmp_path / "map.png").stat().st_size > 10_000
    assert "links between the agents are encrypted" in run.said
    assert not _files_with_keys(tmp_path)
    program, subcommand, records = run.said.split("to look at the flight in a browser: ")[1].split()
    assert (which(program) is not None, subcommand) == (True, "open")
    assert Records([Path(record) for record in glob(records)]).mission.name == "demo"
    for drone in run.drones():
        replayed = replay(tmp_path / "agents" / drone.id / "flight")
        assert replayed.identical, replayed.first
        assert not replayed.truncated
        assert replayed.compared["out/command"] > 100
        assert replayed.compared["out/hypothesis"] > 10


def _files_with_keys(folder: Path) -> list[Path]:
    """Files of a flight, besides the key files themselves, in which the key of a member is found in any usual form."""
    identities = [*folder.glob("agents/*/identity"), folder / "operator"]
    assert len(identities) == 4
    keys = [private_key(identity) for identity in identities]
    pem_lines = [(identity / "key.pem").read_bytes().splitlines()[1] for identity in identities]
    secrets = [*keys, *(key.hex().encode() for key in keys), *(base64.b64encode(key)[:40] for key in keys), *pem_lines]
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != "key.pem"]
    assert any(path.suffix == ".mcap" for path in files)
    return [path for path in files if any(secret in path.read_bytes() for secret in secrets)]
