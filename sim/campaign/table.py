"""The paper's tables with our results beside the published ones.

The `paper` estimators are flown with the paper's own flocking law; any other with that of its scenario. Medians that the paper
leaves undefined are defined in ``radron.sim.scoring.statistics``: the estimation error is the median over the runs of each run's
median.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from rich import box
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table as RichTable

from radron.sim.campaign.flights import Campaign, Flown, Watch, fly_campaign
from radron.sim.campaign.report import write_campaign
from radron.sim.campaign.workers import Executor, Fly, fly_job
from radron.sim.runfile import write_text
from radron.sim.scoring.statistics import Summary, summarise
from radron.sim.sweep import Case

PUBLISHED = "published"


class _Row(NamedTuple):
    """A row of a table: its label, our number in a summary, and its digits."""

    label: str
    of: Callable[[Summary], float | int | None]
    digits: int = 2


TIME_MEDIAN = _Row("time to x0, median (s)", lambda s: s.time_to_x0_median_s)
TIME_MAX = _Row("time to x0, max (s)", lambda s: s.time_to_x0_max_s)
TRACKED_MEAN = _Row("tracking time, mean (s)", lambda s: s.tracking_time_mean_s)
TRACKED_MAX = _Row("tracking time, max (s)", lambda s: s.tracking_time_max_s)
ERROR_MEDIAN = _Row("error, median (m)", lambda s: s.error_median_m)
ERROR_MEAN = _Row("error, mean (m)", lambda s: s.error_mean_m)
BELOW = (  # rows beyond the paper's
    _Row("runs", lambda s: s.runs, 0),
    _Row("runs with x0", lambda s: s.found, 0),
    _Row("runs lost", lambda s: s.lost, 0),
    _Row("bound, median (m)", lambda s: s.bound_median_m),
    _Row("error / bound, median", lambda s: s.error_over_bound),
    _Row("own frames, error (m)", lambda s: s.error_relative_median_m),
    _Row("own frames, bound (m)", lambda s: s.bound_relative_median_m),
    _Row("error of x0, median (m)", lambda s: s.x0_error_median_m),
    _Row("error of x0, 90 % (m)", lambda s: s.x0_error_p90_m),
    _Row("RMS of x0, median (m)", lambda s: s.x0_rms_median_m),
    _Row("NEES, median (ideal: 2)", lambda s: s.nees_median),
    _Row("in the 50 % region (%)", lambda s: _percent(s.in_50, s.sampled), 0),
    _Row("in the 90 % region (%)", lambda s: _percent(s.in_90, s.sampled), 0),
    _Row("separation, least (m)", lambda s: s.min_separation_m),
    _Row("fence breaches", lambda s: s.fence_breaches, 0),
    _Row("x real time, median", lambda s: s.realtime_factor_median, 0),
)


def _percent(hits: int, of: int) -> float | None:
    return 100.0 * hits / of if of else None


@dataclass(frozen=True, slots=True)
class Study:
    """A table of the paper that is reproduced: its scenarios with their column heads, and their published numbers by row."""

    name: str
    title: str
    rows: tuple[_Row, ...]
    heads: Mapping[str, str]
    published: Mapping[str, tuple[float, ...]]


SIMULATIONS = Study(
    "table",
    "Localization and tracking simulation results (paper, Sec. VI-B)",
    (TIME_MEDIAN, TIME_MAX, TRACKED_MEAN, TRACKED_MAX, ERROR_MEDIAN),
    {
        "paper-static-solo": "static solo",
        "paper-static-swarm": "static swarm",
        "paper-moving-solo": "moving solo",
        "paper-moving-swarm": "moving swarm",
    },
    {
        "paper-static-solo": (329.63, 584.67, 167.01, 180.0, 2.59),
        "paper-static-swarm": (59.16, 124.68, 180.0, 180.0, 2.26),
        "paper-moving-solo": (203.66, 359.30, 44.50, 122.43, 20.34),
        "paper-moving-swarm": (52.90, 149.70, 133.30, 180.0, 6.70),
    },
)
FIELD = Study(
    "field",
    "Real-world deployment, three drones (paper, Sec. VII)",
    (TIME_MEDIAN, TIME_MAX, ERROR_MEDIAN, ERROR_MEAN),
    {"field-179MBq": "179 MBq", "field-2GBq": "2 GBq", "field-2GBq-moving": "2 GBq moving"},
    {
        "field-179MBq": (105.46, 115.88, 2.65, 5.04),
        "field-2GBq": (29.55, 34.80, 3.49, 4.89),
        "field-2GBq-moving": (45.88, 139.98, 3.50, 6.24),
    },
)


@dataclass(frozen=True, slots=True)
class Table:
    """A finished table of results.

    ``columns``: (scenario's head, source of the numbers); cells are None without a number. ``note``: definitions of the numbers.
    """

    title: str
    columns: tuple[tuple[str, str], ...]
    rows: tuple[tuple[str, tuple[str | None, ...]], ...]
    above: int  # rows above the line; in the paper's tables, the rows of the paper
    note: str


class Pilot(NamedTuple):
    """The estimator that determines where to fly, and optionally an estimator that only listens and is scored instead."""

    estimator: str
    listen: str | None = None

    @property
    def folder(self) -> str:
        """Part of a folder name that stands for these estimators."""
        return self.estimator if self.listen is None else f"{self.estimator}-heard-by-{self.listen}"

    @property
    def head(self) -> str:
        """Column head that stands for these estimators."""
        return f"our {self.estimator}" if self.listen is None else f"{self.listen} on {self.estimator}'s"


def law_of(estimator: str) -> str | None:
    """Return the flocking law (spacing of the drones) with which an estimator is flown.

    It is the paper's law for the paper's estimators; None: the scenario's own.
    """
    return "paper" if estimator.startswith("paper") else None


def fly_study(
    study: Study,
    cases: Sequence[Case],
    pilots: Sequence[Pilot],
    runs: int,
    folder: Path,
    *,
    execute: Executor,
    watch: Watch,
    fly: Fly = fly_job,
) -> tuple[Table, tuple[Flown, ...]]:
    """Fly the scenarios of a table of the paper with each estimator, and make the table.

    Each estimator's flights are a resumable campaign in a folder of its own. ``{study}.txt``, ``{study}.csv`` and ``{study}.md``
    are written. Raises the errors of ``fly_campaign``.
    """
    flown: list[Flown] = []
    for pilot in pilots:
        campaign = Campaign(tuple(cases), runs, pilot.estimator, law_of(pilot.estimator), listen=pilot.listen)
        place = folder / f"{study.name}-{pilot.folder}"
        flown.append(fly_campaign(campaign, place, execute, fly, watch))
        write_campaign(place, flown[-1])
    table = make_table(study, dict(zip(pilots, flown, strict=True)))
    write_table(folder, study.name, table)
    return table, tuple(flown)


def write_table(folder: Path, name: str, table: Table) -> list[Path]:
    """Write a table as ``{name}.txt``, ``.csv`` and ``.md`` into a folder; return the files."""
    texts = {f"{name}.txt": as_text(table), f"{name}.csv": as_csv(table), f"{name}.md": as_markdown(table)}
    for file, text in texts.items():
        write_text(folder / file, text)
    return [folder / file for file in texts]


def make_table(study: Study, flown: Mapping[Pilot, Flown]) -> Table:
    """Return the table of the published numbers and ours, side by side."""
    columns: list[tuple[str, str]] = []
    cells: list[list[str | None]] = []
    for scenario, head in study.heads.items():
        columns.append((head, PUBLISHED))
        numbers = study.published[scenario]
        cells.append([_text(number, row.digits) for number, row in zip(numbers, study.rows, strict=True)] + [None] * len(BELOW))
        for pilot, campaign in flown.items():
            case = next(case for case in campaign.campaign.cases if case.name == scenario)
            summary = summarise(campaign.of(case))
            columns.append((head, pilot.head))
            cells.append([_text(row.of(summary), row.digits) for row in (*study.rows, *BELOW)])
    labels = [row.label for row in (*study.rows, *BELOW)]
    rows = tuple((label, tuple(column[index] for column in cells)) for index, label in enumerate(labels))
    return Table(study.title, tuple(columns), rows, len(study.rows), NOTE)


def blocks(table: Table, width: int) -> list[Table]:
    """Split a table into parts that fit into ``width`` characters; a scenario's columns stay together."""
    pieces: list[list[int]] = []
    for head in dict.fromkeys(head for head, _ in table.columns):
        more = [index for index, (other, _) in enumerate(table.columns) if other == head]
        if pieces and _width(_part(table, [*pieces[-1], *more])) <= width:
            pieces[-1] += more
        else:
            pieces.append(more)
    return [_part(table, piece) for piece in pieces]


def as_rich(table: Table) -> RichTable:
    """Return a table for the terminal, without its title."""
    rich = RichTable(header_style="", box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    rich.add_column("", no_wrap=True)
    for head, whose in table.columns:
        style = "dim" if whose == PUBLISHED else ""
        rich.add_column(f"{head}\n{whose}", justify="right", style=style, no_wrap=True)
    for index, (label, cells) in enumerate(table.rows):
        rich.add_row(label, *("" if cell is None else cell for cell in cells), end_section=index == table.above - 1)
    return rich


def as_text(table: Table) -> str:
    """Return a table as plain text, as on a sufficiently wide terminal."""
    stream = io.StringIO()
    Console(file=stream, width=_width(table), no_color=True, legacy_windows=False).print(as_rich(table))
    return f"{table.title}\n" + "\n".join(line.rstrip() for line in stream.getvalue().splitlines()) + "\n"


def _part(table: Table, columns: Sequence[int]) -> Table:
    rows = tuple((label, tuple(cells[index] for index in columns)) for label, cells in table.rows)
    return replace(table, columns=tuple(table.columns[index] for index in columns), rows=rows)


def _width(table: Table) -> int:
    console = Console(file=io.StringIO(), width=10_000)
    return Measurement.get(console, console.options, as_rich(table)).maximum


def as_csv(table: Table) -> str:
    """Return a table as CSV; cells without a number are empty."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["", *(f"{head}, {whose}" for head, whose in table.columns)])
    writer.writerows([label, *("" if cell is None else cell for cell in cells)] for label, cells in table.rows)
    return stream.getvalue()


def as_markdown(table: Table) -> str:
    """Return a table as Markdown."""
    lines = [["", *(f"{head}, {whose}" for head, whose in table.columns)], ["---", *("---:" for _ in table.columns)]]
    lines += [[label, *(cell or "" for cell in cells)] for label, cells in table.rows]
    return f"**{table.title}**\n\n" + "".join(f"| {' | '.join(line)} |\n" for line in lines) + f"\n{table.note}\n"


NOTE = (
    "Error: horizontal, of the estimate; the median (mean) over the runs of each run's median (mean) over all its tracking "
    "samples, lost runs included. A run without x0 counts as slower than any other in the median, and as 0 s of tracking. "
    "Bound: posterior Cramer-Rao bound of the median error for the trajectories of each run, with unknown activity and unknown "
    "order of the cones; it depends on the trajectories flown. Own frames: error of the source's position as each vehicle's "
    "localisation sees it. Regions: how often the posterior's 50 % (90 %) region contains the truth, at one sample per run, "
    "half-way through the tracking. Error of x0, 90 %: quantile over the runs. RMS of x0: as stated by the posterior."
)


def _text(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
