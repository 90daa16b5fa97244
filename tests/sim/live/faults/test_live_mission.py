"""A live mission with faults, without its flight: its record."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from radron.sim.campaign.faults.course import LIVE
from radron.sim.campaign.faults.mission import Mission
from radron.sim.live.faults import mission
from radron.sim.live.faults.judge import LiveJudge
from radron.sim.live.monitor import ObservedAgent
from radron.sim.scenario import Scenario
from radron.sim.scoring.invariants.base import Setting, Violation

VIOLATION = Violation(invariant="own-pose", time_s=30.0, drones=("d1",), text="it is elsewhere")


@pytest.mark.parametrize(("violations", "kept"), [([VIOLATION], ["seed-3", "seed-3/truth.jsonl"]), ([], [])])
def test_the_files_of_a_flight_are_kept_where_something_is_violated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, violations: Sequence[Violation], kept: Sequence[str]
) -> None:
    async def flown(scenario: Scenario, seed: int, folder: Path) -> LiveJudge:
        folder.mkdir(exist_ok=True)
        (folder / mission.TRUTH).touch()
        agents = [ObservedAgent(drone.id) for drone in scenario.mission.drones]
        judge = LiveJudge(Setting(scenario, LIVE.heal_s, LIVE.end_s), agents)
        judge.violations += violations
        return judge

    monkeypatch.setattr(mission, "_flown", flown)
    for keep in (tmp_path, None):
        assert mission.fly_live_mission(Mission(3, LIVE), keep).violations == list(violations)
    assert sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*")) == kept
