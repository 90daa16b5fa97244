"""Messages and progress of the commands, on standard error, so that standard output stays clean."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

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

from radron.sim.campaign.flights import Watch
from radron.sim.campaign.workers import Outcome

out = Console(highlight=False)
err = Console(stderr=True, highlight=False)
_PLAIN_EVERY_S = 10.0  # between two lines if there is no terminal


def say(text: str, console: Console = err) -> None:
    """Print a line without wrapping or markup, on standard error by default."""
    console.print(text, markup=False, soft_wrap=True)


@contextmanager
def flight_progress(name: str) -> Iterator[Callable[[float, str], None]]:
    """Show the progress of one simulated flight: the swarm's stage, the simulated time, and the ratio to real time."""
    began = time.monotonic()
    columns = SpinnerColumn(), TextColumn("{task.description}")
    try:
        with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as progress:
            text = f"{name}: preparing"
            task = progress.add_task(escape(text))
            if not err.is_terminal:
                say(text)
            now = Every(_PLAIN_EVERY_S)

            def show(sim_s: float, what: str) -> None:
                elapsed_s = max(time.monotonic() - began, 1e-3)
                text = f"{name}: {what} | {sim_s:.0f} s flown, {sim_s / elapsed_s:.0f} x real time"
                progress.update(task, description=escape(text))
                if not err.is_terminal and now():
                    say(text)

            yield show
    except KeyboardInterrupt:
        say(f"{name}: interrupted; nothing is written")
        raise


@contextmanager
def campaign_progress(name: str) -> Iterator[Watch]:
    """Show the progress of a campaign: number of flights, elapsed and remaining time, and failed flights."""
    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("runs,"),
        TimeElapsedColumn(), TextColumn("elapsed,"), TimeRemainingColumn(), TextColumn("remaining"),
    )  # fmt: skip
    with Progress(*columns, console=err, speed_estimate_period=600.0, disable=not err.is_terminal) as progress:
        task = progress.add_task(name, total=None)
        now = Every(_PLAIN_EVERY_S)

        def show(done: int, total: int, outcome: Outcome[Any, Any] | None) -> None:
            if outcome is None:
                progress.reset(task, total=total, completed=done)
                if done:
                    say(f"{name}: {done} of {total} runs exist already; resuming")
            else:
                progress.update(task, completed=done)
                if outcome.result is None:
                    say(f"{outcome.job.label} failed: {outcome.error}")
            if not err.is_terminal and now():
                say(f"{name}: {done} of {total} runs")

        try:
            yield show
        except KeyboardInterrupt:
            say(f"{name}: interrupted; flights in an --out folder are kept: rerun to resume")
            raise


class Every:
    """A rate limit for output: true at most once in ``every_s`` seconds."""

    def __init__(self, every_s: float) -> None:
        self._every_s = every_s
        self._last_s = time.monotonic()

    def __call__(self) -> bool:
        """Whether the interval since the last true result is over."""
        now_s = time.monotonic()
        if now_s - self._last_s < self._every_s:
            return False
        self._last_s = now_s
        return True
