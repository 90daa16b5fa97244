"""The paper's tables with our results beside them."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import pytest

from radron.sim.campaign import table as table_module
from radron.sim.campaign.table import (
    FIELD,
    SIMULATIONS,
    Pilot,
    Study,
    Table,
    as_csv,
    as_markdown,
    as_text,
    blocks,
    fly_study,
    law_of,
)
from radron.sim.campaign.workers import Job, attempt
from radron.sim.scoring.statistics import summarise
from support.flights import synthetic

pytestmark = pytest.mark.usefixtures("without_figures")
STUDIES = pytest.mark.parametrize("study", [SIMULATIONS, FIELD], ids=["simulations", "field"])


@pytest.fixture
def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """The campaigns behind a table draw no figures (``test_report.py``), which would take most of the time."""
    monkeypatch.setattr(table_module, "write_campaign", lambda folder, flown: [])


def fly(study: Study, folder: Path, pilots: tuple[Pilot, ...] = (Pilot("paper"),), seen: list[Job] | None = None) -> Table:
    def one(job: Job) -> synthetic.RunResult:
        (seen if seen is not None else []).append(job)
        return synthetic.synthetic_result(job.case.name, job.seed, estimator=job.listen or job.estimator or "")

    cases = [synthetic.case(name) for name in study.heads]
    folder.mkdir(exist_ok=True)
    table, flown = fly_study(
        study, cases, pilots, 5, folder,
        execute=lambda jobs, fly_: (attempt(fly_, job) for job in jobs), watch=lambda done, total, outcome: None, fly=one,
    )  # fmt: skip
    assert not any(campaign.failures for campaign in flown)
    return table


def test_the_published_numbers_are_the_papers() -> None:
    columns = list(SIMULATIONS.published.values())
    rows = [row.label for row in SIMULATIONS.rows]
    assert rows[0] == "time to x0, median (s)"
    assert [column[0] for column in columns] == [329.63, 59.16, 203.66, 52.90]
    assert [column[1] for column in columns] == [584.67, 124.68, 359.30, 149.70]
    assert [column[2] for column in columns] == [167.01, 180.0, 44.50, 133.30]
    assert [column[3] for column in columns] == [180.0, 180.0, 122.43, 180.0]
    assert [column[4] for column in columns] == [2.59, 2.26, 20.34, 6.70]
    field = list(FIELD.published.values())
    assert [column[0] for column in field] == [105.46, 29.55, 45.88]
    assert [column[3] for column in field] == [5.04, 4.89, 6.24]


@STUDIES
def test_published_and_ours_stand_side_by_side(study: Study, tmp_path: Path) -> None:
    table = fly(study, tmp_path)
    assert len(table.columns) == 2 * len(study.heads)
    assert table.columns[:2] == (
        (next(iter(study.heads.values())), "published"),
        (next(iter(study.heads.values())), "our paper"),
    )
    first = next(iter(study.heads))
    ours = summarise([synthetic.synthetic_result(first, seed) for seed in range(5)])
    cells = {label: row[:2] for label, row in table.rows}
    assert cells["time to x0, median (s)"] == (f"{study.published[first][0]:.2f}", f"{ours.time_to_x0_median_s:.2f}")
    assert cells["error, median (m)"][1] == f"{ours.error_median_m:.2f}"
    assert cells["separation, least (m)"] == (None, f"{ours.min_separation_m:.2f}")
    assert cells["fence breaches"] == (None, "0")
    assert cells["bound, median (m)"] == (None, f"{ours.bound_median_m:.2f}")
    assert cells["error / bound, median"] == (None, f"{ours.error_over_bound:.2f}")
    assert cells["in the 90 % region (%)"] == (None, f"{100 * ours.in_90 / ours.sampled:.0f}")


def test_every_estimator_has_its_column_and_the_papers_fly_the_papers_law(tmp_path: Path) -> None:
    seen: list[Job] = []
    table = fly(SIMULATIONS, tmp_path, tuple(map(Pilot, ("paper", "paper-geometric", "bayes"))), seen)
    assert [whose for _, whose in table.columns[:4]] == ["published", "our paper", "our paper-geometric", "our bayes"]
    assert {(job.estimator, job.law) for job in seen} == {("paper", "paper"), ("paper-geometric", "paper"), ("bayes", None)}
    assert len(seen) == 4 * 5 * 3
    assert law_of("paper") == "paper"


def test_a_listener_has_a_column_on_the_flights_of_another(tmp_path: Path) -> None:
    seen: list[Job] = []
    table = fly(SIMULATIONS, tmp_path, (Pilot("paper"), Pilot("paper", "bayes")), seen)
    assert [whose for _, whose in table.columns[:3]] == ["published", "our paper", "bayes on paper's"]
    assert {(job.estimator, job.law, job.listen) for job in seen} == {("paper", "paper", None), ("paper", "paper", "bayes")}
    assert (tmp_path / "table-paper-heard-by-bayes" / "runs.jsonl").exists()


def test_the_table_is_written_as_text_csv_and_markdown(tmp_path: Path) -> None:
    table = fly(SIMULATIONS, tmp_path)
    assert (tmp_path / "table.txt").read_text() == as_text(table)
    assert (tmp_path / "table.csv").read_text() == as_csv(table)
    assert (tmp_path / "table.md").read_text() == as_markdown(table)
    assert (tmp_path / "table-paper" / "runs.jsonl").exists()
    rows = list(csv.reader(io.StringIO(as_csv(table))))
    assert {len(row) for row in rows} == {9}
    assert rows[0][1:3] == ["static solo, published", "static solo, our paper"]
    assert rows[1][:2] == ["time to x0, median (s)", "329.63"]
    text = as_text(table)
    assert "\x1b" not in text
    assert all(f"{column[0]:.2f}" in text for column in SIMULATIONS.published.values())
    assert "…" not in text
    lines = [line for line in as_markdown(table).splitlines() if line.startswith("|")]
    assert {line.count("|") for line in lines} == {10}


def test_no_number_is_a_dash_not_a_zero(tmp_path: Path) -> None:
    cases = [synthetic.case(name) for name in SIMULATIONS.heads]

    def never(job: Job) -> synthetic.RunResult:
        return synthetic.synthetic_result(job.case.name, 6)

    table, _ = fly_study(
        SIMULATIONS, cases, [Pilot("paper")], 1, tmp_path,
        execute=lambda jobs, fly_: (attempt(fly_, job) for job in jobs), watch=lambda done, total, outcome: None, fly=never,
    )  # fmt: skip
    cells = dict(table.rows)
    assert cells["time to x0, median (s)"][1] == "-"
    assert cells["tracking time, mean (s)"][1] == "0.00"
    assert cells["runs with x0"][1] == "0"


def test_a_narrow_terminal_gets_the_table_in_pieces(tmp_path: Path) -> None:
    table = fly(SIMULATIONS, tmp_path)
    for width, pieces in [(200, 1), (100, 2), (80, 2), (62, 4), (10, 4)]:
        found = blocks(table, width)
        assert len(found) == pieces
        assert tuple(column for block in found for column in block.columns) == table.columns
        assert tuple(cell for block in found for cell in block.rows[0][1]) == table.rows[0][1]
        if width > 60:
            assert max(len(line) for block in found for line in as_text(block).splitlines()[1:]) <= width
