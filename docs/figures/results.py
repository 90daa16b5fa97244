"""Flies what the documentation gives figures of, and writes them: docs/results.md, the README's table, pictures.

python docs/figures/results.py [NAME ...] [--results DIR] [--no-campaigns]

Flights that are in DIR already are not flown again. All of them take about an hour on two idle cores.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

from radron.sim.campaign.table import SIMULATIONS
from radron.sim.result import RunResult
from radron.sim.scoring.statistics import Summary, summarise

DOCS = Path(__file__).resolve().parents[1]
README = DOCS.parent / "README.md"
BEGIN, END = "<!-- table: docs/figures/results.py -->", "<!-- end of the table -->"
KINDS = ("static-solo", "static-swarm", "moving-solo", "moving-swarm")
FRAMES = ("mixed-frames", "no-gnss", "gnss-lost-midway", "frame-jump", "frame-jump-unannounced", "lying-drone")
HEAD = "| | static, solo | static, swarm | moving, solo | moving, swarm |\n|---|---|---|---|---|\n"


class Study(NamedTuple):
    """A campaign: its folder, and the words of its command."""

    name: str
    command: str

    @property
    def shown(self) -> str:
        """The command as a user types it."""
        return f"`radron-sim {self.command}`"


STUDIES = (
    Study("table", "table --runs 50"),
    Study("ideal", f"consistency {' '.join(f'ideal-{kind}' for kind in KINDS)} --runs 25"),
    Study("biased", f"campaign {' '.join(f'biased-{kind}' for kind in KINDS)} --runs 10"),
    Study("stop", "campaign stop-and-go --runs 30"),
    Study("fast", "campaign fast-2mps fast-3mps --runs 8"),
    Study("walls", "campaign walls-unknown --runs 4"),
    Study("frames", f"campaign {' '.join(FRAMES)} --runs 3"),
)
PICTURES = (  # words of a command, file in its folder, file in docs
    ("run demo --seed 5", "map.png", "demo.png"),
    ("run paper-moving-swarm --seed 5 --estimator bayes", "posterior.png", "posterior.png"),
    ("run stop-and-go --seed 0", "posterior.png", "stop-and-go.png"),
    ("run many-real --seed 743011", "sources.png", "sources.png"),
)


def main() -> None:
    """Fly, then write."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("names", nargs="*", choices=[study.name for study in STUDIES] + [[]], help="only these are flown")
    arguments.add_argument("--results", type=Path, default=Path("results/figures"), help="where the flights are kept")
    arguments.add_argument(
        "--no-campaigns", action="store_true", help="only draw the pictures, and write from the flights that are there"
    )
    chosen = arguments.parse_args()
    for study in STUDIES:
        if not chosen.no_campaigns and (not chosen.names or study.name in chosen.names):
            _radron(study.command, chosen.results / study.name)
    for command, file, name in PICTURES:
        folder = chosen.results / "pictures" / "-".join(command.split())
        if not (folder / file).exists():
            _radron(command, folder)
        shutil.copyfile(folder / file, DOCS / name)
    shutil.copyfile(chosen.results / "ideal" / "consistency.png", DOCS / "consistency.png")
    flown = {study.name: _runs(chosen.results / study.name) for study in STUDIES}
    (DOCS / "results.md").write_text(_page(flown))
    before, _, rest = README.read_text().partition(BEGIN)
    _, _, after = rest.partition(END)
    README.write_text(f"{before}{BEGIN}\n{_paper(flown['table'])}{END}{after}")


def _radron(command: str, folder: Path) -> None:
    print(f"radron-sim {command} --out {folder}", flush=True)
    subprocess.run([sys.executable, "-m", "radron.sim.cli", *command.split(), "--out", str(folder)], check=True)


Runs = dict[tuple[str, str], list[RunResult]]  # by scenario and estimator


def _runs(folder: Path) -> Runs:
    """The flights of a campaign, by their seeds."""
    found: Runs = {}
    for file in sorted(folder.rglob("runs.jsonl")):
        for line in file.read_bytes().splitlines():
            run = msgspec.json.decode(line, type=RunResult)
            found.setdefault((run.scenario, run.estimator), []).append(run)
    return {key: sorted(runs, key=lambda run: run.seed) for key, runs in found.items()}


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _row(label: str, cells: Sequence[str]) -> str:
    return f"| {label} | {' | '.join(cells)} |\n"


def _region(s: Summary) -> str:
    return f"{100 * s.in_50 / s.sampled:.0f} / {100 * s.in_90 / s.sampled:.0f}" if s.sampled else "-"


def _paper(runs: Runs) -> str:
    """The paper's simulations: published, its filter here, and ``bayes``, all on the same scenarios."""
    names = [f"paper-{kind}" for kind in KINDS]
    published = [SIMULATIONS.published[name] for name in names]
    filters, ours = ([summarise(runs[name, estimator]) for name in names] for estimator in ("paper", "bayes"))

    def three(label: str, place: int, of: str, digits: int) -> str:
        cells = [
            f"{_number(paper[place], digits)} / {_number(getattr(one, of), digits)} / **{_number(getattr(two, of), digits)}**"
            for paper, one, two in zip(published, filters, ours, strict=True)
        ]
        return _row(f"{label}: paper / its filter here / **bayes**", cells)

    return (
        HEAD
        + three("time to the initial estimate, median (s)", 0, "time_to_x0_median_s", 0)
        + three("horizontal error, median (m)", 4, "error_median_m", 2)
        + three("tracked of 180 s, mean (s)", 2, "tracking_time_mean_s", 0)
        + _row(
            "lost, of 50 flights: its filter here / **bayes**",
            [f"{a.lost} / **{b.lost}**" for a, b in zip(filters, ours, strict=True)],
        )
        + _row("**bayes**: truth in the 50 % / 90 % region (% of the flights)", [_region(s) for s in ours])
    )


def _group(runs: Runs, names: Sequence[str], labels: Sequence[str]) -> str:
    """A column for each scenario."""
    groups = [summarise(_of(runs, name)) for name in names]

    def row(label: str, cell: Callable[[Summary], str]) -> str:
        return _row(label, [cell(summary) for summary in groups])

    return (
        f"| | {' | '.join(labels)} |\n|---|{'---|' * len(labels)}\n"
        + row("flights; found; lost", lambda s: f"{s.runs}; {s.found}; {s.lost}")
        + row("time to the initial estimate, median (s)", lambda s: _number(s.time_to_x0_median_s, 1))
        + row("its error, median / 90 % (m)", lambda s: f"{_number(s.x0_error_median_m, 1)} / {_number(s.x0_error_p90_m, 1)}")
        + row("horizontal error, median (m)", lambda s: _number(s.error_median_m, 2))
        + row("error in each vehicle's own frame, median (m)", lambda s: _number(s.error_relative_median_m, 2))
        + row("error / bound of the flight, median", lambda s: _number(s.error_over_bound, 2))
        + row("truth in the 50 % / 90 % region (% of the flights)", _region)
        + row("NEES, median of the flights' means (ideal: 2)", lambda s: _number(s.nees_median, 1))
        + row("least separation (m); fence breaches", lambda s: f"{_number(s.min_separation_m, 1)}; {s.fence_breaches}")
    )


def _of(runs: Runs, name: str) -> list[RunResult]:
    return next(of for (scenario, _), of in runs.items() if scenario == name)


def _frames(runs: Runs) -> str:
    lines = (
        "| scenario | flights | all frames known after, at most (s) | error, median (m) "
        "| best drone's own position error (m) | least separation (m) |\n|---|---|---|---|---|---|\n"
    )
    for name in FRAMES:
        of = _of(runs, name)
        s = summarise(of)
        known = [run.frames_known_s for run in of if run.frames_known_s is not None]
        best = sorted(run.best_position_error_m for run in of if run.best_position_error_m is not None)
        cells = (
            f"{s.runs}",
            _number(max(known, default=None), 0) if len(known) == len(of) else f"not in {len(of) - len(known)}",
            _number(s.error_median_m, 2),
            _number(best[len(best) // 2] if best else None, 2),
            _number(s.min_separation_m, 1),
        )
        lines += _row(f"`{name}`", cells)
    return lines


def _page(flown: dict[str, Runs]) -> str:
    """The page: its text with every ``{name}`` replaced by the command or the table of that name."""
    labels = ("static, solo", "static, swarm", "moving, solo", "moving, swarm")
    moved = ["stop-and-go", "fast-2mps", "fast-3mps"]
    tables = {
        "paper": _paper(flown["table"]),
        "ideal": _group(flown["ideal"], [f"ideal-{kind}" for kind in KINDS], labels),
        "biased": _group(flown["biased"], [f"biased-{kind}" for kind in KINDS], labels),
        "moved": _group(flown["stop"] | flown["fast"], moved, [f"`{name}`" for name in moved]),
        "walls": _group(flown["walls"], ["walls-unknown"], ["`walls-unknown`"]),
        "frames": _frames(flown["frames"]),
    }
    commands = {f"{study.name}-command": study.shown for study in STUDIES}
    text = (Path(__file__).parent / "results.md.in").read_text()
    for name, value in (tables | commands).items():
        text = text.replace(f"{{{name}}}", value)
    return text


if __name__ == "__main__":
    main()
