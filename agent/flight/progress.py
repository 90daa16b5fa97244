"""The progress bar of commands that process a recorded flight."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

SHOW_AFTER_S = 2.0  # shorter work shows no progress bar


@contextmanager
def progress_bar(terminal: Console, task: str) -> Iterator[Callable[[float], None]]:
    """Show a progress bar while the ``with`` block runs; it gives a function that takes the share of the work done, 0 .. 1.

    Without a terminal nothing is drawn.
    """
    columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn()
    began_s = time.monotonic()
    with Progress(*columns, console=terminal, transient=True, disable=not terminal.is_terminal) as progress:
        shown = progress.add_task(task, total=1.0, visible=False)
        yield lambda done: progress.update(shown, completed=done, visible=time.monotonic() - began_s > SHOW_AFTER_S)
