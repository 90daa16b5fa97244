"""A whole flight of three agents that localise themselves differently: by GNSS, by RTK, and by SLAM with an unknown heading."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from radron.agent.flight.replay import replay
from support.live.run import live_run

FLIGHT_S = 300.0  # 60 s of it are flown; the machine is shared


@pytest.mark.slow
def test_three_kinds_of_localisation_find_the_source_together(tmp_path: Path) -> None:
    options = ("--seed", "1", "--set", "mission.track.duration_s=12", "--json", str(tmp_path / "run.json"))
    with live_run(tmp_path, "mixed-frames", *options) as run:
        run.process.wait(FLIGHT_S)
        assert run.process.returncode == 0, run.said
        run.until(lambda: not run.processes() and not run.busy_ports(), 5.0)
    d1, d2, d3 = run.drones()
    assert [drone.vehicle.gnss for drone in (d1, d2, d3)] == [True, True, False]
    assert d3.vehicle.vision is not None
    result = json.loads((tmp_path / "run.json").read_text())
    assert result["time_to_x0_s"] is not None
    assert not result["lost"]
    # The best drone knows its place to centimetres; without the frames it would be metres, or anything for an unknown heading.
    assert result["error_median_m"] < 2.0
    assert result["fence_breaches"] == 0
    assert result["min_separation_m"] > 3.0  # each knows the others by sight and by estimated frames
    report = json.loads((tmp_path / "agents.json").read_text())
    assert report["agreed"], run.said
    assert [agent["stage"] for agent in report["agents"]] == ["landed"] * 3
    assert [agent["failsafes"] for agent in report["agents"]] == [0] * 3
    by_satellites, by_vision = (replay(tmp_path / "agents" / drone.id / "flight") for drone in (d1, d3))
    assert by_satellites.calls["in/fix"] > 20  # 1 Hz
    assert "in/fix" not in by_vision.calls
    for flown in (by_satellites, by_vision):
        assert flown.calls["in/sightings"] > 50
        assert flown.identical, flown.first
