"""What the commands show while they work; on the error stream, so that the output stays clean."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from sim.campaign import Watch
from sim.workers import Outcome

out = Console(highlight=False)
err = Console(stderr=True, highlight=False)
_PLAIN_EVERY_S = 10.0  # between two lines where there is no terminal to redraw


def say(text: str, console: Console = err) -> None:
    """A line as it is, however long, on the error stream unless told otherwise."""
    console.print(text, markup=False, soft_wrap=True)


@contextmanager
def flight_progress(name: str) -> Iterator[Callable[[float, str], None]]:
    """Shows one flight: what the swarm is doing, its time, and how much faster than real time that is."""
    began = time.monotonic()
    columns = SpinnerColumn(), TextColumn("{task.description}")
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as progress:
        task = progress.add_task(f"{name}: making ready")
        now = Every(_PLAIN_EVERY_S)

        def show(sim_s: float, what: str) -> None:
            elapsed_s = max(time.monotonic() - began, 1e-3)
            text = f"{name}: {what} | {sim_s:.0f} s flown, {sim_s / elapsed_s:.0f} x real time"
            progress.update(task, description=escape(text))
            if not err.is_terminal and now():
                say(text)

        yield show


@contextmanager
def campaign_progress(name: str) -> Iterator[Watch]:
    """Shows a campaign: how many runs are flown, the time gone and the time to come, and which failed."""
    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("runs,"),
        TimeElapsedColumn(), TextColumn("gone,"), TimeRemainingColumn(), TextColumn("to come"),
    )  # fmt: skip
    with Progress(*columns, console=err, speed_estimate_period=600.0, disable=not err.is_terminal) as progress:
        task = progress.add_task(name, total=None)
        now = Every(_PLAIN_EVERY_S)

        def show(done: int, total: int, outcome: Outcome | None) -> None:
            if outcome is None:
                progress.reset(task, total=total, completed=done)
                if done:
                    say(f"{name}: {done} of {total} runs are there already; going on")
            else:
                progress.update(task, completed=done)
                if outcome.result is None:
                    say(f"{outcome.job.label} failed: {outcome.error}")
            if not err.is_terminal and now():
                say(f"{name}: {done} of {total} runs")

        try:
            yield show
        except KeyboardInterrupt:
            say(f"{name}: stopped; what is flown into an --out folder is kept, and the same command goes on from there")
            raise


class Every:
    """True when called some time after it last was."""

    def __init__(self, every_s: float) -> None:
        self._every_s = every_s
        self._last_s = time.monotonic()

    def __call__(self) -> bool:
        """Whether it is time again."""
        now_s = time.monotonic()
        if now_s - self._last_s < self._every_s:
            return False
        self._last_s = now_s
        return True
