"""``radron-agent audit``: the commands of a flight on the terminal, one line each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from radron.agent.errors import FlightRecordError
from radron.agent.flight.audit import Audited, audit, mission_of
from radron.agent.flight.progress import progress_bar
from radron.agent.flight.reader import REMOVED, UNFINISHED, RecordedFlight
from radron.agent.outputs import printable
from radron.protocol.identity import utc


def run_audit(path: Path) -> None:
    """Print the commands in a flight's record on stdout, with a progress bar on stderr.

    Raises:
        FlightRecordError: there is no record, or it cannot be read; of a partly readable one the readable part is printed first.
    """
    flight = RecordedFlight(path, whole=False)
    terminal = Console(stderr=True)
    with progress_bar(terminal, f"reading {path.name}") as show:
        found = audit(flight, show)
    print(f"{flight.header.drone.id}: {mission_of(flight)}")
    for line in lines(flight.header.drone.id, found):
        print(line)
    if flight.truncated:
        terminal.print(f"{path}: {UNFINISHED}", markup=False, soft_wrap=True)
    lacks = [f"its end: {flight.flaw}"] if flight.flaw is not None else []
    if flight.lacks_beginning:
        lacks.insert(0, f"its beginning: {REMOVED}")
    if lacks:
        raise FlightRecordError(f"{path}: not the whole flight could be read. It lacks {'; '.join(lacks)}")


def lines(drone: str, found: Sequence[Audited]) -> list[str]:
    """Return a line of text for each command: time, sender's name, certificate, action, addressees, and the drone's verdict."""
    if not found:
        return [f"{drone}: no commands"]
    rows = [
        (_time(one.first_ns), one.station, one.signer or "-", one.action or "-", ",".join(one.drones) or "-") for one in found
    ]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return [
        "  ".join([*(cell.ljust(width) for cell, width in zip(row, widths, strict=True)), f"{drone}: {_result(one)}"])
        for row, one in zip(rows, found, strict=True)
    ]


def _result(one: Audited) -> str:
    text = printable(one.result)
    return text if one.copies == 1 else f"{text} ({one.copies} times, the last {_time(one.last_ns)})"


def _time(at_ns: int) -> str:
    return f"{utc(at_ns):%Y-%m-%dT%H:%M:%S}.{at_ns // 1_000_000 % 1000:03d}Z"
