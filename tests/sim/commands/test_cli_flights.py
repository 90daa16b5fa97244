"""The commands that fly, as a user calls them."""

from __future__ import annotations

import errno
import json
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
import pytest
from matplotlib.figure import Figure

import radron.sim.cli
import radron.sim.commands.flights
import radron.sim.lockstep.flight
from radron.agent.errors import ConfigError
from radron.sim.campaign.workers import Fly, Job, Outcome, attempt
from radron.sim.scenario import shipped
from support.flights import synthetic

Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def radron_sim(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """Calls the command; returns exit code, output, error output."""

    def call(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["radron-sim", *map(str, arguments)])
        code = 0
        try:
            radron.sim.cli.main()
        except SystemExit as end:
            code = int(end.code or 0)
        text = capsys.readouterr()
        return code, text.out, text.err

    return call


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Replaces the simulation by made-up flights in this process; the arguments that they were flown with. Figures are made and
    saved, but not drawn (``test_report.py`` draws all kinds), which would take most of the time.
    """
    calls: list[dict[str, Any]] = []

    def fly(scenario: Any, seed: int, **options: Any) -> synthetic.Flight:
        calls.append({"scenario": scenario, "seed": seed, **options})
        if seed == 13:
            raise RuntimeError("the rotor fell off")
        flight = synthetic.synthetic_flight(drones=len(scenario.mission.drones))
        if options.get("progress"):
            options["progress"](1.0, "survey")
        estimator = options.get("estimator") or "paper"
        result = synthetic.synthetic_result(scenario.name, seed, drones=len(scenario.mission.drones), estimator=estimator)
        heard = {name: msgspec.structs.replace(result, estimator=name) for name in options.get("listen", ())}
        return synthetic.Flight(result, flight.trace, heard)

    def in_line(workers: int) -> Callable[[Iterable[Job], Fly], Iterator[Outcome[Job, synthetic.RunResult]]]:
        return lambda jobs, one: (attempt(one, job) for job in jobs)

    monkeypatch.setattr(radron.sim.lockstep.flight, "fly", fly)
    monkeypatch.setattr(radron.sim.commands.flights, "in_processes", in_line)
    monkeypatch.setattr(Figure, "savefig", lambda figure, path, **options: Path(path).touch())
    return calls


def test_run_says_one_sentence_and_writes_what_was_asked_for(
    tmp_path: Path, radron_sim: Call, flown: list[dict[str, Any]]
) -> None:
    code, out, _ = radron_sim("run", "paper-static-swarm", "--seed", 3, "--json", tmp_path / "r.json", "--out", tmp_path / "o")
    assert code == 0
    assert out.startswith("Source estimate: (")
    assert out.count("\n") == 1
    assert {path.name for path in (tmp_path / "o").iterdir()} == {
        "result.json", "map.png", "error.png", "posterior.png", "spacing.png",
    }  # fmt: skip
    assert (tmp_path / "o" / "result.json").read_text() == (tmp_path / "r.json").read_text()
    assert json.loads((tmp_path / "r.json").read_text())["seed"] == 3
    assert (flown[0]["scenario"].name, flown[0]["seed"], flown[0]["law"]) == ("paper-static-swarm", 3, None)


def test_run_puts_only_the_object_on_the_output(radron_sim: Call, flown: list[dict[str, Any]]) -> None:
    code, out, err = radron_sim("run", "demo", "--json", "-")
    assert code == 0
    assert json.loads(out)["scenario"] == "demo"
    assert "Source estimate: (" in err


def test_run_passes_on_estimator_law_listeners_and_settings(radron_sim: Call, flown: list[dict[str, Any]]) -> None:
    code, out, err = radron_sim(
        "run", "demo", "--estimator", "paper-geometric", "--listen", "paper", "--law", "paper", "--set", "radius_m=9",
        "--json", "-",
    )  # fmt: skip
    assert code == 0
    assert (flown[0]["estimator"], list(flown[0]["listen"]), flown[0]["law"]) == ("paper-geometric", ["paper"], "paper")
    assert flown[0]["scenario"].mission.encirclement.radius_m == 9.0
    assert [json.loads(line)["estimator"] for line in out.splitlines()] == ["paper-geometric", "paper"]
    assert "paper, listening only: median error" in err


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["run", "dmeo"], "unknown scenario 'dmeo'"),
        (["run", "demo", "--seed", "-1"], "--seed -1"),
        (["run", "demo", "--estimator", "papper"], "estimator"),
        (["run", "demo", "--law", "rough"], "law"),
        (["run", "demo", "--listen", "nobody"], "estimator"),
        (["run", "demo", "--set", "source.activity_bq=-3e9"], "activity_bq"),
        (["run", "demo", "--set", "drones=0"], "drones"),
        (["run", "demo", "--json", "no/such/folder/r.json"], "no/such/folder"),
        (["campaign", "dmeo"], "unknown scenario 'dmeo'"),
        (["campaign", "demo", "--runs", "0"], "--runs 0"),
        (["campaign", "demo", "--sweep", "radius_m"], "--sweep radius_m"),
        (["campaign", "demo", "--sweep", "radius=8,9"], "radius"),
        (["campaign", "demo", "--workers", "2", "--dask", "tcp://x:1"], "give one of them"),
        (["campaign", "demo", "--estimator", "papper"], "estimator"),
        (["table", "--estimators", "paper,paper"], "--estimators"),
        (["table", "--estimators", "papper"], "estimator"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(
    tmp_path: Path, radron_sim: Call, flown: list[dict[str, Any]], arguments: list[str], named: str
) -> None:
    out = tmp_path / "out"
    code, output, error = radron_sim(*arguments, "--out", out)
    assert code == 2
    assert output == ""
    assert error.startswith("radron-sim: ")
    assert error.count("\n") == 1
    assert named in error
    assert not flown
    assert not out.exists()


def test_no_worker_is_bad_input(tmp_path: Path, radron_sim: Call) -> None:
    assert radron_sim("campaign", "demo", "--workers", 0, "--out", tmp_path / "o")[0] == 2
    assert not (tmp_path / "o").exists()


def test_a_campaign_prints_its_summary_and_goes_on(tmp_path: Path, radron_sim: Call, flown: list[dict[str, Any]]) -> None:
    arguments = ("campaign", "demo", "--runs", 3, "--sweep", "drones=2,3", "--estimator", "paper", "--out", tmp_path)
    code, out, _ = radron_sim(*arguments)
    assert code == 0
    assert [line.split(":")[0] for line in out.splitlines()] == ["demo drones=2", "demo drones=3"]
    assert "in 3 of 3 runs" in out
    assert {path.name for path in tmp_path.iterdir()} == {
        "campaign.json", "runs.jsonl", "summary.csv", "sources.csv", "summary.md", "boxes.png", "ecdf.png", "tuning.png"
    }  # fmt: skip
    assert len(flown) == 6
    again = radron_sim(*arguments)
    assert again[:2] == (0, out)
    assert "6 of 6 runs exist already" in again[2]
    assert len(flown) == 6


def test_a_campaign_can_judge_an_estimator_that_only_listens(
    tmp_path: Path, radron_sim: Call, flown: list[dict[str, Any]]
) -> None:
    code, _, _ = radron_sim("campaign", "demo", "--runs", 2, "--estimator", "paper", "--listen", "bayes", "--out", tmp_path)
    assert code == 0
    assert {(call["estimator"], call["listen"]) for call in flown} == {("paper", ("bayes",))}
    lines = [json.loads(line) for line in (tmp_path / "runs.jsonl").read_text().splitlines()]
    assert [line["estimator"] for line in lines] == ["bayes", "bayes"]


def test_failed_flights_end_a_campaign_with_code_1_and_are_named(
    tmp_path: Path, radron_sim: Call, flown: list[dict[str, Any]]
) -> None:
    code, out, err = radron_sim("campaign", "demo", "--runs", 3, "--seed-base", 12, "--out", tmp_path)
    assert code == 1
    assert "1 flights failed: demo seed 13" in err
    assert "RuntimeError: the rotor fell off" in err
    assert out.startswith("demo: initial estimate after ")
    assert "in 2 of 2 runs" in out
    assert len((tmp_path / "runs.jsonl").read_text().splitlines()) == 2


def test_the_table_flies_paper_by_the_papers_law_and_bayes_as_the_scenario_says(
    tmp_path: Path, radron_sim: Call, flown: list[dict[str, Any]]
) -> None:
    code, out, _ = radron_sim("table", "--runs", 2, "--field", "--out", tmp_path)
    assert code == 0
    assert {(call["estimator"], call["law"]) for call in flown} == {("paper", "paper"), ("bayes", None)}
    assert len(flown) == 2 * 2 * (4 + 3)
    assert {"table.txt", "table.csv", "table.md", "field.txt", "field.csv", "field.md"} <= {
        path.name for path in tmp_path.iterdir()
    }
    assert "329.63" in out
    assert "105.46" in out


def test_the_table_needs_no_folder(
    radron_sim: Call, flown: list[dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, _ = radron_sim("table", "--runs", 1)
    assert code == 0
    assert "20.34" in out
    assert list(tmp_path.iterdir()) == []


def test_errors_of_the_simulation_that_the_user_can_mend_are_one_line(radron_sim: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    def fly(*arguments: object, **options: object) -> None:
        raise ConfigError("the scenario cannot be flown")

    monkeypatch.setattr(radron.sim.lockstep.flight, "fly", fly)
    assert radron_sim("run", "demo")[::2] == (2, "demo: preparing\nradron-sim: the scenario cannot be flown\n")


def test_consistency_holds_claims_against_the_truth_and_goes_on(
    tmp_path: Path, radron_sim: Call, flown: list[dict[str, Any]]
) -> None:
    code, out, err = radron_sim("consistency", "ideal-static-swarm", "demo", "--runs", 4, "--out", tmp_path)
    assert code == 0
    assert "in the 90 % region (%)" in out
    assert "Clopper" in out
    assert {(call["scenario"].name, call["estimator"]) for call in flown} == {("ideal-static-swarm", "bayes"), ("demo", "bayes")}
    assert "consistency.png" in err
    assert radron_sim("consistency", "ideal-static-swarm", "demo", "--runs", 4, "--out", tmp_path)[0] == 0
    assert len(flown) == 8


def test_consistency_of_failed_flights_ends_with_code_1(radron_sim: Call, flown: list[dict[str, Any]]) -> None:
    code, out, err = radron_sim("consistency", "demo", "--runs", 2, "--seed-base", 12)
    assert code == 1
    assert "demo seed 13" in err
    assert "1 flights failed" in out


def test_the_version_is_told(radron_sim: Call) -> None:
    code, out, _ = radron_sim("--version")
    assert code == 0
    assert out == f"radron {version('radron')}\n"


def test_the_shipped_scenarios_are_listed(radron_sim: Call) -> None:
    code, out, _ = radron_sim("scenarios")
    assert code == 0
    assert [line.split()[0] for line in out.splitlines()] == shipped()
    column = max(map(len, shipped())) + 2
    assert f"{'demo':{column}}Three drones find a source" in out.splitlines()[shipped().index("demo")]


def test_a_flight_of_more_drones(radron_sim: Call, flown: list[dict[str, Any]]) -> None:
    code, *_ = radron_sim("run", "demo", "--drones", 5)
    assert code == 0
    assert len(flown[0]["scenario"].mission.drones) == 5


@pytest.mark.parametrize(
    ("address", "problem"),
    [
        ("127.0.0.1:9", "no Dask cluster answers .Connection refused."),
        ("tls://127.0.0.1:9", "no Dask cluster answers .Connection refused."),
        ("scheduler", "expected the address of a scheduler, such as"),
        ("tcp://[::1", "expected the address of a scheduler, such as"),
    ],
)
def test_no_cluster_is_one_line(radron_sim: Call, tmp_path: Path, address: str, problem: str) -> None:
    code, _, err = radron_sim("campaign", "demo", "--runs", 1, "--dask", address, "--out", tmp_path / "out")
    assert code == 2
    assert re.search(problem, err)
    assert len(err.strip().splitlines()) == 1


def test_a_disk_that_fails_is_one_line(radron_sim: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    def fly(*_: object, **__: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), "/data/x")

    monkeypatch.setattr(radron.sim.lockstep.flight, "fly", fly)
    code, _, told = radron_sim("run", "demo")
    assert (code, told.splitlines()[-1]) == (2, "radron-sim: /data/x: Read-only file system")


def test_a_radius_that_the_smooth_law_does_not_heed_is_told(radron_sim: Call, flown: list[dict[str, Any]]) -> None:
    _, _, told = radron_sim("run", "demo", "--set", "radius_m=10")
    assert "note: radius_m is only the upper limit of the circle's radius" in told
    assert "note:" not in radron_sim("run", "demo", "--set", "radius_m=10", "--law", "paper")[2]
