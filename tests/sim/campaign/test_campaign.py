"""Campaigns: order, resumption, failures, and the same result with every executor."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import psutil
import pytest

from radron.agent.errors import ConfigError
from radron.sim.campaign.flights import Campaign, fly_campaign, result_of
from radron.sim.campaign.report import write_campaign
from radron.sim.campaign.workers import Fly, Job, Outcome, attempt, in_processes, on_dask
from support import PATH
from support.flights import synthetic

WALL = ("wall_s", "realtime_factor")
DEADLINE_S = 30.0


def in_line(jobs: Iterable[Job], fly: Fly) -> Iterator[Outcome[Job, synthetic.RunResult]]:
    for job in jobs:
        yield attempt(fly, job)


def small(runs: int = 4) -> Campaign:
    cases = tuple(synthetic.case(name, radius_m=radius) for name in ("near", "far") for radius in (12.0, 8.0))
    return Campaign(cases, runs, "paper")


def lines(folder: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in (folder / "runs.jsonl").read_text().splitlines()]


def without_wall(folder: Path) -> list[dict[str, object]]:
    return [{key: value for key, value in line.items() if key not in WALL} for line in lines(folder)]


def test_runs_are_in_the_order_of_scenario_point_and_seed(tmp_path: Path) -> None:
    flown = fly_campaign(small(), tmp_path, in_line, synthetic.fly_synthetic)
    order = [(line["scenario"], line["radius_m"], line["seed"]) for line in lines(tmp_path)]
    assert order == [(name, radius, seed) for name in ("far", "near") for radius in (12.0, 8.0) for seed in range(4)]
    assert [result.seed for result in flown.of(small().cases[0])] == [0, 1, 2, 3]
    assert flown.of(small().cases[1])[2].error_median_m == synthetic.synthetic_result("near", 2, 8.0).error_median_m


def test_a_line_is_the_flat_result_with_the_sweep_beside_it(tmp_path: Path) -> None:
    fly_campaign(small(1), tmp_path, in_line, synthetic.fly_synthetic)
    line = lines(tmp_path)[0]
    assert not any(isinstance(value, dict | list) for value in line.values())
    expected = synthetic.synthetic_result("far", 0, 12.0)
    assert result_of(line).error_median_m == expected.error_median_m  # to the last bit
    assert set(line) == {*expected.__struct_fields__, "radius_m"}


def test_one_and_two_processes_give_the_same_file(tmp_path: Path) -> None:
    for workers in (1, 2):
        fly_campaign(small(3), tmp_path / str(workers), in_processes(workers), synthetic.fly_synthetic)
    assert without_wall(tmp_path / "1") == without_wall(tmp_path / "2")
    assert len(lines(tmp_path / "1")) == 12


def test_each_process_computes_with_one_thread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    flown = fly_campaign(Campaign((synthetic.case(),), 1), tmp_path, in_processes(1), synthetic.fly_threads)
    assert not flown.failures
    assert os.environ["OMP_NUM_THREADS"] == "7"


def test_a_killed_campaign_goes_on_where_it_stopped(tmp_path: Path) -> None:
    folder, flag = tmp_path / "out", tmp_path / "flag"
    script = f"""
import sys
sys.path.insert(0, {PATH!r})
from support.flights import synthetic
from radron.sim.campaign.flights import Campaign, fly_campaign
from radron.sim.campaign.workers import in_processes
from pathlib import Path
if __name__ == "__main__":
    case = synthetic.Case("near", {{"flag": {str(flag)!r}}})
    fly_campaign(Campaign((case,), 5), Path({str(folder)!r}), in_processes(2), synthetic.fly_pausing)
"""
    (tmp_path / "killed.py").write_text(script)
    process = subprocess.Popen([sys.executable, str(tmp_path / "killed.py")])
    try:
        runs = folder / "runs.jsonl"
        wait_until(lambda: runs.exists() and b"\n" in runs.read_bytes() and len(list(tmp_path.glob("*.pid"))) == 2)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    for path in tmp_path.glob("*.pid"):
        wait_until(lambda pid=int(path.stem): not running(pid))  # none goes on behind its back
    assert [line["seed"] for line in lines(folder)] == [0]
    with (folder / "runs.jsonl").open("a") as stream:
        stream.write('{"scenario":"near","se')  # as if killed while writing

    flown_now: list[int] = []

    def fly(job: Job) -> synthetic.RunResult:
        flown_now.append(job.seed)
        return synthetic.fly_synthetic(job)

    seen: list[tuple[int, int]] = []
    case = synthetic.Case("near", {"flag": str(flag)})  # type: ignore[arg-type]
    flown = fly_campaign(Campaign((case,), 5), folder, in_line, fly, lambda done, total, _: seen.append((done, total)))
    assert flown_now == [1, 2, 3, 4]
    assert seen == [(1, 5), (2, 5), (3, 5), (4, 5), (5, 5)]
    assert [line["seed"] for line in lines(folder)] == [0, 1, 2, 3, 4]
    assert len(flown.lines) == 5


def test_nothing_is_flown_twice(tmp_path: Path) -> None:
    fly_campaign(small(), tmp_path, in_line, synthetic.fly_synthetic)
    before = (tmp_path / "runs.jsonl").read_bytes()

    def never(job: Job) -> synthetic.RunResult:
        raise AssertionError(job.label)

    flown = fly_campaign(small(), tmp_path, in_line, never)
    assert not flown.failures
    assert (tmp_path / "runs.jsonl").read_bytes() == before


@pytest.mark.parametrize(
    ("other", "named"),
    [
        (small(5), "runs: 4 there, 5 here"),
        (Campaign(small().cases, 4, "paper-geometric"), 'estimator: "paper" there, "paper-geometric" here'),
        (Campaign(small().cases, 4, "paper", law="paper"), "law"),
        (Campaign(small().cases, 4, "paper", seed_base=1), "seed_base"),
        (Campaign(small().cases[:2], 4, "paper"), "cases"),
    ],
)
def test_another_campaign_in_the_folder_is_refused(tmp_path: Path, other: Campaign, named: str) -> None:
    fly_campaign(small(), tmp_path, in_line, synthetic.fly_synthetic)
    before = (tmp_path / "runs.jsonl").read_bytes()
    with pytest.raises(ConfigError, match="holds another campaign") as caught:
        fly_campaign(other, tmp_path, in_line, synthetic.fly_synthetic)
    assert named in str(caught.value)
    assert "\n" not in str(caught.value)
    assert (tmp_path / "runs.jsonl").read_bytes() == before


def test_a_scenario_that_was_edited_meanwhile_is_another_campaign(tmp_path: Path) -> None:
    original = synthetic.Case("near", {"activity": 3e9})  # type: ignore[arg-type]
    edited = synthetic.Case("near", {"activity": 2e9})  # type: ignore[arg-type]
    fly_campaign(Campaign((original,), 1), tmp_path, in_line, synthetic.fly_synthetic)
    with pytest.raises(ConfigError, match="content"):
        fly_campaign(Campaign((edited,), 1), tmp_path, in_line, synthetic.fly_synthetic)


@pytest.mark.parametrize(
    ("content", "named"),
    [
        ('{"scenario":"near"}\nnonsense\n{}\n', "runs.jsonl:2"),
        ("[1]\n", "runs.jsonl:1"),
        ('{"seed":1}\n', "runs.jsonl:1"),
        ('{"scenario":"near"}\n' * 2, "runs.jsonl:2: .* twice"),
    ],
)
def test_a_damaged_file_is_told_with_its_line(tmp_path: Path, content: str, named: str) -> None:
    campaign = Campaign((synthetic.case(),), 1)
    fly_campaign(campaign, tmp_path, in_line, synthetic.fly_synthetic)
    good = (tmp_path / "runs.jsonl").read_text()
    (tmp_path / "runs.jsonl").write_text(content.replace('{"scenario":"near"}\n', good))
    with pytest.raises(ConfigError, match=named):
        fly_campaign(campaign, tmp_path, in_line, synthetic.fly_synthetic)


def test_runs_of_unknown_origin_are_refused(tmp_path: Path) -> None:
    (tmp_path / "runs.jsonl").write_text("{}\n")
    with pytest.raises(ConfigError, match=r"no campaign\.json"):
        fly_campaign(small(), tmp_path, in_line, synthetic.fly_synthetic)


def test_a_failed_flight_is_recorded_and_the_others_go_on(tmp_path: Path) -> None:
    campaign = Campaign((synthetic.case(),), 5)
    flown = fly_campaign(campaign, tmp_path, in_processes(2), synthetic.fly_failing)
    assert [outcome.job.label for outcome in flown.failures] == ["near seed 2"]
    assert [line["seed"] for line in lines(tmp_path)] == [0, 1, 3, 4]
    (record,) = [json.loads(line) for line in (tmp_path / "failures.jsonl").read_text().splitlines()]
    assert (record["scenario"], record["seed"], record["error"]) == ("near", 2, "RuntimeError: the rotor fell off")
    assert "fly_failing" in record["traceback"]

    flown = fly_campaign(campaign, tmp_path, in_line, synthetic.fly_synthetic)  # fixed: only the missing mission is flown
    assert [line["seed"] for line in lines(tmp_path)] == [0, 1, 2, 3, 4]
    assert not flown.failures
    assert not (tmp_path / "failures.jsonl").exists()


def test_a_flight_of_which_nothing_is_heard_is_a_failed_one(tmp_path: Path) -> None:
    def forgetful(jobs: Iterable[Job], fly: Fly) -> Iterator[Outcome[Job, synthetic.RunResult]]:
        return (attempt(fly, job) for job in jobs if job.seed != 3)

    flown = fly_campaign(Campaign((synthetic.case(),), 5), tmp_path, forgetful, synthetic.fly_failing)
    assert [outcome.job.seed for outcome in flown.failures] == [2, 3]
    assert len((tmp_path / "failures.jsonl").read_text().splitlines()) == 2
    write_campaign(tmp_path, flown)
    assert "2 flights failed and are in none of these numbers: near seed 2, near seed 3." in (tmp_path / "summary.md").read_text()


def test_a_flight_that_kills_its_process_is_found_out_and_the_others_go_on(tmp_path: Path) -> None:
    flown = fly_campaign(Campaign((synthetic.case(),), 5), tmp_path, in_processes(2), synthetic.fly_dying)
    assert [(outcome.job.seed, outcome.error) for outcome in flown.failures] == [
        (2, "the worker process died (out of memory, or killed)")
    ]
    assert [line["seed"] for line in lines(tmp_path)] == [0, 1, 3, 4]


def test_a_dask_cluster_gives_the_same_file(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    fly_campaign(small(3), tmp_path / "here", in_line, synthetic.fly_synthetic)
    with distributed.LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None) as cluster:
        execute = on_dask(cluster.scheduler_address)
        fly_campaign(small(3), tmp_path / "there", execute, synthetic.fly_synthetic)
        flown = fly_campaign(Campaign((synthetic.case(),), 4), tmp_path / "failing", execute, synthetic.fly_failing)
    assert without_wall(tmp_path / "here") == without_wall(tmp_path / "there")
    assert [outcome.error for outcome in flown.failures] == ["RuntimeError: the rotor fell off"]


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://x"])
def test_no_cluster_at_the_address(tmp_path: Path, address: str) -> None:
    with pytest.raises(ConfigError, match="no Dask cluster answers") as caught:
        fly_campaign(small(1), tmp_path, on_dask(address, timeout_s=0.2), synthetic.fly_synthetic)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Campaign((synthetic.case(),), 0),
        lambda: Campaign((synthetic.case(),), 1, seed_base=-1),
        lambda: Campaign((), 1),
        lambda: in_processes(0),
    ],
)
def test_impossible_campaigns(make: object) -> None:
    with pytest.raises(ConfigError):
        make()  # type: ignore[operator]


def wait_until(condition: object) -> None:
    end = time.monotonic() + DEADLINE_S
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


def running(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
