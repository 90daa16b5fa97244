"""State of a fleet's onboard computers in one table with marked differences, for ``radron-deploy status``."""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from radron.deploy.fleet.config import FleetDrone, Px4Config
from radron.deploy.fleet.loading import Fleet
from radron.deploy.remote import Host
from radron.protocol.onboard import MAX_BOOT_ATTEMPTS, Computer

if TYPE_CHECKING:
    from rich.table import Table

_DAY_NS = 86_400_000_000_000
_CLOCK_S = 0.5  # between a computer's clock and this one; drones with a larger difference do not start
_SOON_DAYS = 7.0
_MIN_FREE_AFTER_UPDATE_MB = 1000
_SAME = 1e-5  # relative, of a parameter: the link has single precision
# Each drone has its own altitude layer and launch place; the last parameter is set at the takeoff.
_OWN = {"RTL_RETURN_ALT", "RTL_DESCEND_ALT", "GF_MAX_HOR_DIST", "MIS_TAKEOFF_ALT"}
Kind = tuple[bool, bool]  # localisation of an autopilot: by satellites, and by vision


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell of the table of computers.

    ``stands_out``: the text differs from the other computers' text, or needs the operator's attention.
    """

    text: str
    stands_out: bool = False

    def __str__(self) -> str:
        """Return the text with a mark that stands out without colours, too."""
        return f"! {self.text}" if self.stands_out else self.text


@dataclass(frozen=True, slots=True)
class Answer:
    """State of an onboard computer, with the times of question and answer by this computer's clock (nanoseconds UTC)."""

    computer: Computer
    asked_ns: int
    told_ns: int


def rows(answers: Sequence[tuple[Host, Answer]], fleet: Fleet | None) -> list[dict[str, Cell]]:
    """Return a table row for each onboard computer: cells by column, with differences marked.

    The values of ``fleet`` are the reference. Without a value there, all drones should have the same release, the same version of
    PX4, and the same parameters of autopilots with the same kind of localisation.
    """
    drones = [_drone(host, fleet) for host, _ in answers]
    usual = _usual(answers, drones)
    made = [_row(host, answer, fleet, drone, usual[_kind(drone)]) for (host, answer), drone in zip(answers, drones, strict=True)]
    _mark_other(made, "release", [None] * len(made))
    _mark_other(made, "PX4", [None if drone is None else drone.px4.version for drone in drones])
    return made


def table(made: Sequence[dict[str, Cell]]) -> Table:
    """Return the rows as a table for the terminal."""
    from rich.markup import escape  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    drawn = Table(*made[0], box=None, pad_edge=False)
    for row in made:
        drawn.add_row(*(f"[bold red]{escape(str(cell))}[/]" if cell.stands_out else escape(cell.text) for cell in row.values()))
    return drawn


def _drone(host: Host, fleet: Fleet | None) -> FleetDrone | None:
    """Return a computer's drone in the fleet file; None if not listed."""
    drones = fleet.config.drones if fleet is not None else ()
    return next((drone for drone in drones if drone.id == host.name or drone.address == host.address), None)


def _kind(drone: FleetDrone | None) -> Kind:
    """Return the kind of localisation of a drone's autopilot: the right parameters depend on it."""
    return (True, False) if drone is None else (drone.vehicle.gnss, drone.vehicle.vision is not None)


def _mark_other(made: Sequence[dict[str, Cell]], column: str, given: Sequence[str | None]) -> None:
    """Mark values that differ from most drones' value, except values given by the fleet file."""
    usual = Counter(row[column].text for row, wanted in zip(made, given, strict=True) if wanted is None)
    if not usual:
        return
    (most, _), *_ = usual.most_common(1)
    for row, wanted in zip(made, given, strict=True):
        if wanted is None and row[column].text != most:
            row[column] = Cell(row[column].text, stands_out=True)


def _row(
    host: Host, answer: Answer, fleet: Fleet | None, drone: FleetDrone | None, usual: Mapping[str, float]
) -> dict[str, Cell]:
    told = answer.computer
    return {
        "drone": Cell(host.name),
        "release": _release(told, fleet),
        "slot": _slot(told),
        "last update": _outcome(told),
        "agent": _agent(told),
        "mesh": _mesh(told),
        "autopilot": _answers(told, lambda report: report.autopilot),
        "camera": _camera(told, drone),
        "PX4": _px4(told, Px4Config() if drone is None else drone.px4, usual),
        "disk": Cell(
            f"{told.disk_free_mb / 1000:.1f} of {told.disk_mb / 1000:.1f} GB free", told.disk_free_mb < _MIN_FREE_AFTER_UPDATE_MB
        ),
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
        return Cell(f"{told.slot}, on trial, attempt {told.attempts} of {MAX_BOOT_ATTEMPTS}", stands_out=True)
    return Cell(told.slot or "none")


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


def _camera(told: Computer, drone: FleetDrone | None) -> Cell:
    if drone is not None and drone.detector.driver == "none":
        return Cell("none")
    return _answers(told, lambda report: report.camera)


def _px4(told: Computer, judged: Px4Config, usual: Mapping[str, float]) -> Cell:
    """Return the version, and the parameters that differ from the fleet file or, if not listed there, from most drones."""
    if told.report is None or told.report.px4 is None:
        return Cell("?", stands_out=judged != Px4Config())
    found = told.report.parameters
    wrong = [] if judged.version in (None, told.report.px4) else [f"not {judged.version}"]
    for name, value in judged.parameters.items():
        if name not in found:
            wrong.append(f"{name} is not told")
        elif _differ(found[name], value):
            wrong.append(f"{name} is {found[name]:g}, not {value:g}")
    for name in sorted(found.keys() & usual.keys() - judged.parameters.keys() - _OWN):
        if _differ(found[name], usual[name]):
            wrong.append(f"{name} is {found[name]:g}, elsewhere {usual[name]:g}")
    return Cell("; ".join((told.report.px4, *wrong)), stands_out=bool(wrong))


def _usual(answers: Sequence[tuple[Host, Answer]], drones: Sequence[FleetDrone | None]) -> dict[Kind, dict[str, float]]:
    """Return the most frequent value of each parameter, among the drones of each kind."""
    values: dict[Kind, dict[str, Counter[float]]] = defaultdict(lambda: defaultdict(Counter))
    for (_, answer), drone in zip(answers, drones, strict=True):
        counted = values[_kind(drone)]
        for name, value in answer.computer.report.parameters.items() if answer.computer.report is not None else ():
            counted[name][value] += 1
    return {kind: {name: found.most_common(1)[0][0] for name, found in counted.items()} for kind, counted in values.items()}


def _differ(one: float, other: float) -> bool:
    return abs(one - other) > _SAME * max(1.0, abs(other))


def _clock(answer: Answer) -> Cell:
    """Return the clock's offset from this computer's clock; the answer came between question and end of the reply."""
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
