"""The report on whether an estimator's stated uncertainty matches its errors."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import msgspec
import numpy as np
import pytest

from radron.sim.campaign.consistency import SCENARIOS, Share, consistency_of, consistency_table, write_consistency
from radron.sim.campaign.flights import Campaign, fly_campaign
from radron.sim.campaign.workers import Job, attempt
from radron.sim.result import RunResult
from radron.sim.scenario import shipped
from support.flights import synthetic


def claiming(factor: float, runs: int = 200) -> list[RunResult]:
    """Runs of an estimator with errors ``factor`` times the claimed ones."""
    nees = factor**2 * np.random.default_rng(5).chisquare(2, runs)
    result = synthetic.synthetic_result("near", 1, estimator="bayes")
    return [
        msgspec.structs.replace(result, seed=seed, nees_sample=float(one), region=1.0 - float(np.exp(-0.5 * one)))
        for seed, one in enumerate(nees)
    ]


def verdicts(runs: list[RunResult]) -> list[str | None]:
    table = consistency_table([consistency_of("near", runs)])
    return [cells[0] for label, cells in table.rows if label == "agrees"]


def test_an_estimator_that_is_as_good_as_it_says_agrees() -> None:
    found = consistency_of("near", claiming(1.0))
    assert verdicts(claiming(1.0)) == ["yes", "yes"]
    assert found.nees_mean is not None
    assert found.nees_low is not None
    assert found.nees_high is not None
    assert found.nees_low < 2.0 < found.nees_high
    assert found.nees_low < found.nees_mean < found.nees_high
    assert found.uniform_p is not None
    assert found.uniform_p > 0.05


@pytest.mark.parametrize(("factor", "verdict"), [(1.3, "too seldom"), (0.75, "too often")])
def test_one_that_is_too_sure_or_not_sure_enough_does_not(factor: float, verdict: str) -> None:
    """By a quarter to a third: the difference that 200 runs can show."""
    found = consistency_of("near", claiming(factor))
    assert verdicts(claiming(factor)) == [verdict, verdict]
    assert found.uniform_p is not None
    assert found.uniform_p < 0.01
    assert found.nees_mean is not None
    assert found.nees_low is not None
    assert found.nees_high is not None
    assert not found.nees_low < found.nees_mean < found.nees_high


def test_runs_without_a_claim_are_in_no_coverage() -> None:
    runs = [*claiming(1.0, 20), synthetic.synthetic_result("near", 6)]
    found = consistency_of("near", runs)
    assert (found.runs, found.in_50.of, found.error.count, found.x0_error.count, found.lost) == (21, 20, 20, 20, 1)
    empty = consistency_of("near", [synthetic.synthetic_result("near", 6)])
    assert (empty.nees_mean, empty.error.median, empty.in_90) == (None, None, Share(0, 0, None, None))
    assert verdicts([synthetic.synthetic_result("near", 6)]) == [None, None]


def test_x0_is_held_against_eight_metres() -> None:
    runs = [msgspec.structs.replace(run, x0_error_m=float(seed)) for seed, run in enumerate(claiming(1.0, 12))]
    found = consistency_of("near", runs)
    assert (found.x0_within.hits, found.x0_within.of) == (9, 12)
    assert found.x0_error.largest == 11.0


def test_the_default_scenarios_are_there() -> None:
    assert set(SCENARIOS) <= set(shipped())


def test_table_and_picture_are_written_beside_the_runs(tmp_path: Path) -> None:
    def fly(job: Job) -> RunResult:
        if job.seed == 3:
            raise RuntimeError("the rotor fell off")
        return synthetic.synthetic_result(job.case.name, job.seed, estimator="bayes")

    campaign = Campaign((synthetic.case("near"), synthetic.case("far")), 6, "bayes")
    flown = fly_campaign(campaign, tmp_path, lambda jobs, one: (attempt(one, job) for job in jobs), fly)
    table, written = write_consistency(tmp_path, flown)
    assert {path.name for path in written} == {f"consistency.{suffix}" for suffix in ("txt", "csv", "md", "json", "png")}
    assert table.columns == (("near", "bayes"), ("far", "bayes"))
    assert (tmp_path / "consistency.png").read_bytes().startswith(b"\x89PNG")
    first, second = json.loads((tmp_path / "consistency.json").read_text())
    assert (first["scenario"], first["runs"], first["in_90"]["of"], second["scenario"]) == ("near", 5, 5, "far")
    rows = list(csv.reader((tmp_path / "consistency.csv").open()))
    assert ["runs", "5", "5"] in rows
    assert "2 flights failed" in (tmp_path / "consistency.md").read_text()
