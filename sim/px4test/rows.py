"""Rows of a flight test's table of results: name, result, and figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec
from msgspec import Struct

from radron.sim.runfile import write_text

_MAX_LINE_LENGTH = 300  # longest line: a process's last output can be a whole traceback


class Row(Struct, frozen=True):
    """Result of one flight test.

    failures: criteria that were not met, in words; empty: the test passed. figures: measured values in SI units, by name.
    """

    name: str
    failures: tuple[str, ...] = ()
    figures: dict[str, float] = {}

    @property
    def passed(self) -> bool:
        """Whether all criteria were met."""
        return not self.failures


class Checks:
    """Collects the results of a flight test's criteria."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._failures: list[str] = []
        self.figures: dict[str, float] = {}

    def ask(self, holds: bool, otherwise: str) -> None:
        """Record a failure with the text ``otherwise`` unless the criterion ``holds``."""
        if not holds:
            self._failures.append(otherwise)

    def at_most(self, name: str, value: float | None, limit: float) -> None:
        """Record a measured value that has an upper limit; None: it was never reached."""
        if value is None:
            self._failures.append(f"{name}: never")
            return
        self.figures[name] = round(value, 3)
        self.ask(value <= limit, f"{name}: {value:.2f}, more than {limit:g}")

    def at_least(self, name: str, value: float, limit: float) -> None:
        """Record a measured value that has a lower limit."""
        self.figures[name] = round(value, 3)
        self.ask(value >= limit, f"{name}: {value:.2f}, less than {limit:g}")

    def row(self) -> Row:
        """Return the result of the flight test."""
        return Row(self._name, tuple(self._failures), self.figures)


class Report(Struct, frozen=True, kw_only=True):
    """Report on all flight tests.

    vehicles: kind of vehicles. truth: source of their true positions. wall_s: duration. repeated: results that failed in sessions
    that were then flown again.
    """

    vehicles: str
    truth: str
    wall_s: float
    rows: tuple[Row, ...]
    repeated: tuple[Row, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether all tests passed, including repeated ones."""
        return all(row.passed for row in self.rows)


def table(report: Report) -> list[str]:
    """Return the report as lines of text."""
    width = max((len(row.name) for row in (*report.repeated, *report.rows)), default=0)
    lines = [f"Flown: {report.vehicles}; judged by: {report.truth}; {report.wall_s:.0f} s"]
    lines += [line for row in report.repeated for line in _lines(row, "AGAIN ", width)]
    lines += [line for row in report.rows for line in _lines(row, "passed" if row.passed else "FAILED", width)]
    return [line[:_MAX_LINE_LENGTH] for line in lines]


def _lines(row: Row, verdict: str, width: int) -> list[str]:
    figures = ", ".join(f"{name} {value:g}" for name, value in row.figures.items())
    return [f"{verdict}  {row.name:<{width}}  {figures}", *(f"        {'':<{width}}  {failure}" for failure in row.failures)]


def write(folder: Path, report: Report) -> Sequence[Path]:
    """Write the report into a folder, as ``report.json`` and ``report.txt``."""
    files = folder / "report.json", folder / "report.txt"
    write_text(files[0], msgspec.json.format(msgspec.json.encode(report).decode(), indent=2) + "\n")
    write_text(files[1], "\n".join(table(report)) + "\n")
    return files
