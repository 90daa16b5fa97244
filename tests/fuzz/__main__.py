"""Command line of ``make fuzz``.

Run: python -m tests.fuzz [TARGET ...] [--share 1.0] [--seed 1] [--workers N] [--minutes 60] [--out results/fuzz] [--case N]

All targets, or the named ones, with ``--share`` of their inputs; ``--case``: one case of one target, with its whole trace. Exit
code 1 where there is a finding or time was too short. Interrupted, it goes on where it was when called again with the same seed
and share.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter, defaultdict
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from radron.sim.campaign.workers import cores
from tests.fuzz.runner import Journal, Outcome, chunks, keep, run
from tests.fuzz.target import run_case
from tests.fuzz.targets import TARGETS

_SHOWN = 3  # lines for findings of one kind


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"one or more of {', '.join(TARGETS)}; none: all")
    parser.add_argument("--share", type=float, default=1.0, help="of the inputs of a whole run")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=cores())
    parser.add_argument("--minutes", type=float, default=60.0, help="end after this time, whatever is left")
    parser.add_argument("--out", type=Path, default=Path("results/fuzz"))
    parser.add_argument("--case", type=int, help="run one case of one target")
    options = parser.parse_args()
    unknown = [name for name in options.targets if name not in TARGETS]
    if unknown:
        parser.error(f"unknown target {unknown[0]!r}; there are {', '.join(TARGETS)}")
    if options.case is not None:
        if len(options.targets) != 1:
            parser.error("--case needs one target")
        return replay(options.targets[0], options.seed, options.case)
    options.out.mkdir(parents=True, exist_ok=True)
    return fuzz(options.targets or list(TARGETS), options)


def replay(name: str, seed: int, number: int) -> int:
    """Run one case, and print its finding."""
    with tempfile.TemporaryDirectory() as folder:
        probe, finding = run_case(TARGETS[name](Path(folder)), seed, number)
    if finding is None:
        print(f"{name} {number}: {probe.count} inputs, nothing found")
        return 0
    print(f"{finding.trace}\ninput {probe.count} of the case: {finding.data[:500]!r}")
    return 1


def fuzz(names: list[str], options: argparse.Namespace) -> int:
    """Run the targets; the exit code."""
    journal, console = Journal(options.out, options.seed, options.share), Console(stderr=True)
    planned = chunks(names, options.share, options.seed)
    todo = [chunk for chunk in planned if chunk not in journal.done]
    totals, kinds = defaultdict[str, list[Outcome]](list), Counter[str]()
    for chunk, inputs in journal.done.items():
        totals[chunk.target].append(Outcome(chunk, inputs))
    end_s, late = time.monotonic() + 60.0 * options.minutes, False
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with tempfile.TemporaryDirectory(prefix="radron-fuzz-") as folder, Progress(*columns, console=console) as progress:
        bar = progress.add_task("fuzzing", total=len(planned), completed=len(planned) - len(todo), rate="")
        for outcome in run(todo, options.workers, Path(folder)):
            journal.add(outcome)
            totals[outcome.chunk.target].append(outcome)
            for finding in outcome.findings:
                kinds[f"{finding.target}: {finding.kind}"] += 1
                if kinds[f"{finding.target}: {finding.kind}"] <= _SHOWN:
                    path = keep(finding, options.out)
                    console.print(f"{finding.target}: {finding.kind}: {finding.replay} ({path})", markup=False, soft_wrap=True)
            rate = outcome.inputs / max(outcome.cpu_s, 1e-9)
            progress.update(bar, advance=1, description=outcome.chunk.target, rate=f"{rate:.0f}/s and core")
            late = time.monotonic() > end_s
            if late:
                break
    _print(totals)
    for kind, count in kinds.most_common():
        print(f"{count} x {kind}")
    if late:
        print(f"not finished within {options.minutes:g} minutes; the same command goes on")
    return 1 if kinds or late else 0


def _print(totals: dict[str, list[Outcome]]) -> None:
    table = Table()
    table.add_column("target")
    for head in ("inputs", "per core-second", "slowest, ms", "findings"):
        table.add_column(head, justify="right")
    for name, outcomes in totals.items():
        now = [one for one in outcomes if one.cpu_s > 0.0]
        rate = sum(one.inputs for one in now) / max(1e-9, sum(one.cpu_s for one in now))
        slowest_ms = 1e3 * max((one.slowest_s for one in now), default=0.0)
        found = sum(len(one.findings) for one in outcomes)
        table.add_row(name, f"{sum(one.inputs for one in outcomes):,}", f"{rate:.0f}", f"{slowest_ms:.1f}", str(found))
    Console().print(table)


if __name__ == "__main__":
    sys.exit(main())
