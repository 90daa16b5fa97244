"""A campaign of real, if short, flights."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from radron.sim.campaign.flights import Campaign, fly_campaign
from radron.sim.campaign.workers import in_processes
from radron.sim.sweep import cases

SHORT = {"source.activity_bq": 3e10, "end.track_s": 2.0}  # strong enough for x0 within seconds


@pytest.mark.slow
def test_the_same_seeds_give_the_same_runs_with_one_or_two_workers(tmp_path: Path) -> None:
    found = []
    for workers in (1, 2):
        plan = Campaign(cases(["paper-static-solo"], {"radius_m": (8, 12)}, SHORT), 2, "paper", law="paper")
        flown = fly_campaign(plan, tmp_path / str(workers), in_processes(workers))
        assert not flown.failures
        lines = [json.loads(line) for line in (tmp_path / str(workers) / "runs.jsonl").read_text().splitlines()]
        found.append([{key: line[key] for key in line if key not in ("wall_s", "realtime_factor")} for line in lines])
    assert found[0] == found[1]
    assert [(line["radius_m"], line["seed"]) for line in found[0]] == [(8, 0), (8, 1), (12, 0), (12, 1)]
    assert all(line["time_to_x0_s"] is not None and line["tracking_time_s"] >= 1.9 for line in found[0])
    assert found[0][0]["time_to_x0_s"] == found[0][2]["time_to_x0_s"]  # the radius does not matter before x0
    assert found[0][0]["x0_error_m"] != found[0][1]["x0_error_m"]
