"""Real agents that fly by an estimator with long steps: each computes it in a process of its own."""

from __future__ import annotations

import json
from pathlib import Path

import psutil
import pytest

from radron.agent.flight import topics
from radron.agent.flight.reader import RecordedFlight
from radron.agent.flight.replay import replay
from support.live.run import live_run, stretched

FLIGHT_S = 300.0  # 60 s of it are flown; the machine is shared
STEP_S = 0.2  # for a step of the pilot, on a machine with nothing else to do; a search for further sources takes as long


@pytest.mark.slow
def test_three_agents_fly_by_several_sources_and_their_loops_do_not_wait(tmp_path: Path) -> None:
    options = (
        "--estimator",
        "sources",
        "--seed",
        "1",
        "--set",
        "mission.track.duration_s=20",
        "--json",
        str(tmp_path / "run.json"),
    )
    with live_run(tmp_path, "paper-demo", *options) as run:
        run.process.wait(FLIGHT_S)
        assert run.process.returncode == 0, run.said
        run.until(lambda: not run.processes() and not run.busy_ports(), 5.0)
    computing = [pid for drone in run.drones() for pid in folding_processes(tmp_path / "agents" / drone.id / "agent.log")]
    assert len(computing) == 3
    assert not [one for one in psutil.process_iter() if one.pid in computing and one.status() != psutil.STATUS_ZOMBIE]
    result = json.loads((tmp_path / "run.json").read_text())
    assert (result["estimator"], result["sources_true"]) == ("sources", 1)
    assert result["error_median_m"] < 3.5  # threshold of its report
    assert not result["lost"]
    report = json.loads((tmp_path / "agents.json").read_text())
    assert report["agreed"], run.said
    assert [agent["problems"] for agent in report["agents"]] == [[]] * 3
    for drone in run.drones():
        flight = tmp_path / "agents" / drone.id / "flight"
        replayed = replay(flight)
        assert replayed.identical, replayed.first
        assert replayed.calls[topics.ANSWERED] > 50
        assert replayed.compared[topics.HYPOTHESIS] > 10
        assert longest_step_s(flight) < stretched(STEP_S)


def folding_processes(log: Path) -> list[int]:
    """Ids of the processes that computed for an agent."""
    events = [json.loads(line) for line in log.read_text().splitlines() if line.startswith("{")]
    return [event["pid"] for event in events if event["event"] == "the process of the estimator is ready"]


def longest_step_s(flight: Path) -> float:
    """From a call of the pilot's step to its command, by the clock."""
    began_ns, longest_ns = 0, 0
    for record in RecordedFlight(flight).records((topics.STEP, topics.COMMAND)):
        if record.topic == topics.STEP:
            began_ns = record.publish_ns
        else:
            longest_ns = max(longest_ns, record.publish_ns - began_ns)
    return longest_ns * 1e-9
