"""``radron-deploy status``: what a fleet's onboard computers tell of themselves, in one table in which differences stand out."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from deploy.fleet.loading import Fleet
from deploy.remote import Host
from protocol.onboard import MOST_ATTEMPTS, Computer

if TYPE_CHECKING:
    from rich.table import Table

_DAY_NS = 86_400_000_000_000
_CLOCK_S = 0.5  # between a computer and this one; drones whose clocks differ by more do not start
_SOON_DAYS = 7.0
_LEAST_FREE_MB = 1000
_ALIKE = ("release", "PX4")  # of these all have the same


@dataclass(frozen=True, slots=True)
class Cell:
    """A text, and whether it is out of the ordinary: another one than the others', or one that somebody should look at."""

    text: str
    stands_out: bool = False

    def __str__(self) -> str:
        """Without colours, too, it stands out."""
        return f"! {self.text}" if self.stands_out else self.text


@dataclass(frozen=True, slots=True)
class Answer:
    """What a computer told, and how far this computer's clock went meanwhile (UTC, nanoseconds)."""

    computer: Computer
    asked_ns: int
    told_ns: int


def rows(answers: Sequence[tuple[Host, Answer]], fleet: Fleet | None) -> list[dict[str, Cell]]:
    """A row for each computer, by column."""
    made = [_row(host, answer, fleet) for host, answer in answers]
    for column in _ALIKE:
        usual = Counter(row[column].text for row in made).most_common(1)
        for row in made:
            if row[column].text != usual[0][0]:
                row[column] = Cell(row[column].text, stands_out=True)
    return made


def table(made: Sequence[dict[str, Cell]]) -> Table:
    """As a table."""
    from rich.markup import escape  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    drawn = Table(*made[0], box=None, pad_edge=False)
    for row in made:
        drawn.add_row(*(f"[bold red]{escape(str(cell))}[/]" if cell.stands_out else escape(cell.text) for cell in row.values()))
    return drawn


def _row(host: Host, answer: Answer, fleet: Fleet | None) -> dict[str, Cell]:
    told = answer.computer
    return {
        "drone": Cell(host.name),
        "release": _release(told, fleet),
        "slot": _slot(told),
        "last update": _outcome(told),
        "agent": _agent(told),
        "mesh": _mesh(told),
        "autopilot": _answers(told, lambda report: report.autopilot),
        "camera": _answers(told, lambda report: report.camera),
        "PX4": _px4(told, fleet),
        "disk": Cell(f"{told.disk_free_mb / 1000:.1f} of {told.disk_mb / 1000:.1f} GB free", told.disk_free_mb < _LEAST_FREE_MB),
        "clock": _clock(answer),
        "certificate": _certificate(told, answer.told_ns),
    }


def _release(told: Computer, fleet: Fleet | None) -> Cell:
    wanted = fleet.config.version if fleet is not None else None
    if wanted is not None and told.release.version != wanted:
        return Cell(f"{told.release}, the fleet file wants {wanted}", stands_out=True)
    return Cell(str(told.release))


def _slot(told: Computer) -> Cell:
    if told.trial is not None and told.trial.slot == told.slot:
        return Cell(f"{told.slot}, on trial, attempt {told.attempts} of {MOST_ATTEMPTS}", stands_out=True)
    return Cell(told.slot)


def _outcome(told: Computer) -> Cell:
    outcome = told.outcome
    if told.trial is not None and told.trial.slot != told.slot:
        return Cell(f"{told.trial.release} is being installed", stands_out=True)
    if outcome is None:
        return Cell("none")
    at = time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(outcome.stamp_ns * 1e-9))
    return Cell(f"good, {at}") if outcome.kind == "good" else Cell(f"{outcome.kind}, {at}: {outcome.text}", stands_out=True)


def _agent(told: Computer) -> Cell:
    if told.report is None:
        return Cell(told.agent, stands_out=True)
    return Cell(f"{told.report.stage}, armed" if told.report.armed else str(told.report.stage))


def _mesh(told: Computer) -> Cell:
    if told.report is None:
        return Cell("?", stands_out=True)
    return Cell(", ".join(told.report.alive) or "hears nobody")


def _answers(told: Computer, which: Callable[..., bool]) -> Cell:
    if told.report is None:
        return Cell("?", stands_out=True)
    return Cell("answers") if which(told.report) else Cell("no answer", stands_out=True)


def _px4(told: Computer, fleet: Fleet | None) -> Cell:
    """Version and the parameters that differ from the fleet file's."""
    if told.report is None or told.report.px4 is None:
        return Cell("?")
    if fleet is None or fleet.config.px4 is None:
        return Cell(told.report.px4)
    wanted, found = fleet.config.px4, told.report
    wrong = [
        f"{name} is {found.parameters[name]:g}, not {value:g}"
        for name, value in wanted.parameters.items()
        if name in found.parameters and abs(found.parameters[name] - value) > _SAME * max(1.0, abs(value))
    ]
    if wanted.version is not None and found.px4 != wanted.version:
        wrong.insert(0, f"not {wanted.version}")
    return Cell("; ".join((str(found.px4), *wrong)), stands_out=bool(wrong))


_SAME = 1e-5  # relative: the link has single precision


def _clock(answer: Answer) -> Cell:
    """Against this computer's; the answer came at some time between question and end."""
    told_ns = answer.computer.clock_ns
    offset_s = 0.0
    if told_ns < answer.asked_ns:
        offset_s = (told_ns - answer.asked_ns) * 1e-9
    elif told_ns > answer.told_ns:
        offset_s = (told_ns - answer.told_ns) * 1e-9
    if abs(offset_s) > _CLOCK_S:
        return Cell(f"{offset_s:+.1f} s from this computer's", stands_out=True)
    own = answer.computer.clock_offset_s
    return Cell("no time server") if own is None else Cell(f"{own * 1e3:+.1f} ms from its servers", abs(own) > _CLOCK_S)


def _certificate(told: Computer, now_ns: int) -> Cell:
    if told.certificate_ns is None:
        return Cell("none", stands_out=True)
    left_days = (told.certificate_ns - now_ns) / _DAY_NS
    return Cell("expired" if left_days <= 0.0 else f"{left_days:.0f} days left", stands_out=left_days < _SOON_DAYS)
