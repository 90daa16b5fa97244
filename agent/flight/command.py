"""``radron-agent replay``: progress and verdict on the terminal."""

from __future__ import annotations

import time
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.table import Table

from agent.flight.replay import ReplayReport, replay

SHOW_AFTER_S = 2.0  # nobody needs a progress bar for less
IDENTICAL, DIFFERENT, UNUSABLE = 0, 1, 2  # exit codes


def run_replay(path: Path) -> int:
    """Replay a flight, with a progress bar on stderr and the verdict on stdout; returns the exit code. Raises RadronError."""
    terminal = Console(stderr=True)
    columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn()
    began_s = time.monotonic()
    with Progress(*columns, console=terminal, transient=True, disable=not terminal.is_terminal) as progress:
        task = progress.add_task(f"replaying {path.name}", total=1.0, visible=False)

        def show(done: float) -> None:
            progress.update(task, completed=done, visible=time.monotonic() - began_s > SHOW_AFTER_S)

        report = replay(path, show)
    out = Console(highlight=False, soft_wrap=True)
    out.print(_table(report))
    out.print(verdict(report), markup=False)
    if report.differing:
        return DIFFERENT
    return UNUSABLE if report.flaw is not None else IDENTICAL


def verdict(report: ReplayReport) -> str:
    """What came of it, in a sentence or two."""
    made = sum(report.compared.values())
    text = f"{report.drone}, {report.duration_s:.1f} s"
    if report.truncated:
        text += " (the records end without a proper end: the process was killed, or is still writing)"
    if report.first is None:
        text += f": all {made} results are identical, bit for bit"
    else:
        first = report.first
        text += (
            f": {sum(report.differing.values())} of {made} results differ, the first {first.time_s:.3f} s into the flight"
            f" ({first.log_ns} ns UTC), {first.topic}: recorded {first.recorded}, replayed {first.replayed}. Recorded with "
            + ", ".join(f"{name} {version}" for name, version in report.versions.items())
        )
    if report.flaw is not None:
        text += f". Only the flight up to there could be replayed: {report.flaw}"
    return text


def _table(report: ReplayReport) -> Table:
    table = Table()
    table.add_column("record")
    for heading in ("number", "differing"):
        table.add_column(heading, justify="right")
    for topic, count in sorted(report.calls.items()):
        table.add_row(topic, str(count), str(report.differing.get(topic, "")))
    for topic, count in sorted(report.compared.items()):
        table.add_row(topic, str(count), str(report.differing.get(topic, 0)))
    return table
