"""Comparison of a benchmark's measurements with its goals, as a table with a verdict for each goal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from rich.console import Console
from rich.table import Table


class Goal(NamedTuple):
    """``measured`` must be ``most`` at most; both in ``unit``. ``detail``: origin of the measurement."""

    what: str
    measured: float
    most: float
    unit: str
    detail: str = ""

    @property
    def is_met(self) -> bool:
        return self.measured <= self.most


def show(title: str, goals: Sequence[Goal]) -> None:
    """Print the goals with their verdicts."""
    table = Table(title=title)
    for head in ("", "measured", "goal", "verdict", "of"):
        table.add_column(head, justify="right" if head in ("measured", "goal") else "left")
    for goal in goals:
        verdict = "met" if goal.is_met else "MISSED"
        table.add_row(goal.what, f"{goal.measured:.2f} {goal.unit}", f"<= {goal.most:g} {goal.unit}", verdict, goal.detail)
    Console(width=140).print(table)
