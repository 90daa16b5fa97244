"""A campaign of missions that are not flown: resumed, summed up, and its missions made smaller."""

import json
from pathlib import Path

import pytest

from radron.agent.errors import ConfigError
from radron.sim.campaign.faults.campaign import FaultCampaign, fly_faults
from radron.sim.campaign.faults.course import DEALT, FULL, LIVE, SHORT
from radron.sim.campaign.faults.minimise import minimise
from radron.sim.campaign.faults.mission import Mission, Verdict
from radron.sim.campaign.faults.summary import summarise, table, told, write_summary
from radron.sim.campaign.workers import attempt
from radron.sim.scoring.invariants.base import Violation
from radron.sim.scoring.invariants.judge import ANY


def verdict(mission: Mission) -> Verdict:
    """Violated where a seed is odd, or a kill is among the faults."""
    faults = mission.drawn["fault"]
    drones = [drone["id"] for drone in mission.drawn["mission"]["drones"]]
    violation = Violation(invariant="separation", time_s=12.0, drones=("d1", "d2"), text="2.10 m apart, at least 2.5 m wanted")
    violated = mission.seed % 2 == 1 if mission.document is None else any(fault["kind"] == "kill" for fault in faults)
    return Verdict(
        seed=mission.seed,
        drones=len(drones),
        faults=faults,
        violations=[violation] if violated else [],
        able=2,
        located=not violated,
        converged=True,
        error_m=0.5,
        min_separation_m=2.1,
        sim_s=90.0,
        drone_s=300.0,
        core_s=9.0,
    )


def in_line(jobs, fly):
    return (attempt(fly, job) for job in jobs)


def test_missions_are_kept_and_the_same_call_resumes(tmp_path: Path) -> None:
    flown = []

    def fly(mission: Mission) -> Verdict:
        flown.append(mission.seed)
        if len(flown) == 3:
            raise KeyboardInterrupt
        return verdict(mission)

    campaign = FaultCampaign(4, 10)
    with pytest.raises(KeyboardInterrupt):
        fly_faults(campaign, tmp_path, in_line, fly)
    found = fly_faults(campaign, tmp_path, in_line, fly)
    assert flown == [10, 11, 12, 12, 13]
    assert [one.seed for one in found.verdicts] == [10, 11, 12, 13]
    lines = [json.loads(line) for line in (tmp_path / "missions.jsonl").read_text().splitlines()]
    assert [line["seed"] for line in lines] == [10, 11, 12, 13]
    wanted = ("seed", "faults", "violations", "able", "located", "error_m", "min_separation_m", "sim_s", "core_s")
    assert all(key in lines[0] for key in wanted)
    assert fly_faults(campaign, tmp_path, in_line, fly) == found
    assert fly_faults(FaultCampaign(5, 10), tmp_path, in_line, fly).verdicts[:4] == found.verdicts


def test_a_mission_that_could_not_be_judged_is_flown_again(tmp_path: Path) -> None:
    def failing(mission: Mission) -> Verdict:
        raise ValueError("no")

    found = fly_faults(FaultCampaign(2), tmp_path, in_line, failing)
    assert found.verdicts == ()
    assert [outcome.job.label for outcome in found.failures] == ["seed 0", "seed 1"]
    assert len(fly_faults(FaultCampaign(2), tmp_path, in_line, verdict).verdicts) == 2


def test_a_folder_holds_one_campaign_and_nothing_else(tmp_path: Path) -> None:
    fly_faults(FaultCampaign(2, 10), tmp_path, in_line, verdict)
    with pytest.raises(ConfigError, match="holds another campaign"):
        fly_faults(FaultCampaign(2, 11), tmp_path, in_line, verdict)
    with pytest.raises(ConfigError, match="holds another campaign"):
        fly_faults(FaultCampaign(2, 10, first=True), tmp_path, in_line, verdict)
    (tmp_path / "missions.jsonl").write_text('{"seed": 10}\n')
    with pytest.raises(ConfigError, match=r"missions.jsonl:1: not a mission"):
        fly_faults(FaultCampaign(2, 10), tmp_path, in_line, verdict)


def test_missions_that_end_at_their_first_violation() -> None:
    assert [mission.until for mission in FaultCampaign(2, first=True).missions()] == [ANY, ANY]
    assert [mission.until for mission in FaultCampaign(1).missions()] == [None]


@pytest.mark.parametrize(("runs", "seed", "text"), [(0, 0, "--runs 0"), (1, -1, "--seed -1")])
def test_a_campaign_of_nothing_is_refused(runs: int, seed: int, text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        FaultCampaign(runs, seed)


def test_the_summary_counts_missions_and_kinds(tmp_path: Path) -> None:
    verdicts = [verdict(Mission(seed)) for seed in range(20)]
    summary = summarise(verdicts)
    assert (summary.missions, summary.violated, summary.violations, summary.separation_breaches) == (20, 10, 10, 10)
    assert (summary.collisions, summary.able, summary.able_swarm, summary.located, summary.converged) == (0, 20, 20, 10, 20)
    assert (summary.core_s, summary.sim_s, summary.core_s_per_drone_s) == (180.0, 1800.0, pytest.approx(0.03))
    row = summary.kinds[0]
    struck = [one for one in verdicts if any(fault["kind"] == row.kind for fault in one.faults)]
    assert (row.missions, row.violated) == (len(struck), sum(bool(one.violations) for one in struck))
    assert table(summary).splitlines()[-1].split("|")[1:-1] != []
    assert told(verdicts[0], FULL) == []
    assert told(verdicts[1], FULL) == [
        "seed 1: separation at 12.00 s, d1 d2: 2.10 m apart, at least 2.5 m wanted",
        "  again: radron-sim faults --seed 1 --runs 1",
    ]
    for course, command in ((SHORT, "faults --short"), (DEALT, "faults --dealt"), (LIVE, "live-faults")):
        assert told(verdicts[1], course)[-1] == f"  again: radron-sim {command} --seed 1 --runs 1"
    names = [path.name for path in write_summary(tmp_path, summary)]
    assert names == ["summary.json", "summary.md", "kinds.png"]
    assert json.loads((tmp_path / "summary.json").read_text())["violations"] == 10


def test_a_mission_is_stripped_of_all_that_its_violation_does_not_need() -> None:
    seed = next(seed for seed in range(1, 400, 2) if [fault["kind"] for fault in Mission(seed).drawn["fault"]].count("kill") == 1)
    found = minimise(Mission(seed), verdict)
    assert found is not None
    document, violation = found
    assert [fault["kind"] for fault in document["fault"]] == ["kill"]
    assert document["fault"][0].get("for_s", 0.0) < 1.0
    assert len(document["mission"]["drones"]) == 2
    assert "sightings" not in document
    assert violation.invariant == "separation"


def test_a_mission_without_a_violation_is_not_made_smaller() -> None:
    assert minimise(Mission(2), verdict) is None
