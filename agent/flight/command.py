"""``radron-agent replay``: progress and result on the terminal."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.table import Table

from radron.agent.flight.progress import progress_bar
from radron.agent.flight.reader import UNFINISHED
from radron.agent.flight.replay import ReplayReport, replay

IDENTICAL, DIFFERENT, UNUSABLE = 0, 1, 2  # exit codes


def run_replay(path: Path) -> int:
    """Replay a flight, with a progress bar on stderr and the result on stdout; return the exit code. Raises RadronError."""
    terminal, out = Console(stderr=True), Console(highlight=False, soft_wrap=True)
    with progress_bar(terminal, f"replaying {path.name}") as show:
        report = replay(path, show)
    out.print(_table(report))
    out.print(verdict(report), markup=False)
    if report.identical:
        return IDENTICAL
    return DIFFERENT if report.differing else UNUSABLE


def verdict(report: ReplayReport) -> str:
    """Return the result of a replay in one or two sentences."""
    made = sum(report.compared.values())
    text = f"{report.drone}, {report.duration_s:.1f} s"
    if report.truncated:
        text += f" ({UNFINISHED})"
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
