"""Common features of two timelines of a vehicle: sequences of states and announcements, and delays from causes to effects."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

Rows = list[list[Any]]
BEAT_MS = 2_150.0  # a state that heartbeats show for less may be half as long, and fall between two
GRID_MS = 450.0  # the same of EXTENDED_SYS_STATE
UNSTEADY_EVENTS = {
    0x167C97B,  # no ground station: repeated with each summary of the checks
    0x1FDF2ED,  # heading not stable: at the start only, see the tests of it
    0x1AF6FD6,  # vertical drift of satellites: by chance
    0x159387D,  # a battery that is too low to shut down: PX4's simulator cannot
    0x1013630,  # recorded once; unknown
}
UNSTEADY_TEXTS = (
    "Critical battery",  # in one of two recordings, though its event is there
    "Preflight: GPS Vertical Pos Drift",
    "System does not support shutdown",
    "Preflight Fail: heading",
)


def of_kind(rows: Rows, kind: str) -> Rows:
    """Rows of one kind."""
    return [row for row in rows if row[1] == kind]


class State(NamedTuple):
    """A state shown; brief: for so short a time that another phase of the messages may leave it out."""

    values: tuple[Any, ...]
    brief: bool


def states(rows: Rows, brief_ms: float, end_ms: float) -> list[State]:
    """In sequence."""
    return [State(tuple(row[2:]), after[0] - row[0] < brief_ms) for row, after in pairwise([*rows, [end_ms, ""]])]


def agree(one: list[State], other: list[State], last: tuple[Any, ...] | None = None) -> bool:
    """Whether the two are the same except for brief states; ``last``: what both have shown before, and may show on."""
    if not one and not other:
        return True
    if one and other and one[0].values == other[0].values and agree(one[1:], other[1:], one[0].values):
        return True
    skips_one = bool(one) and (one[0].brief or one[0].values == last)
    skips_other = bool(other) and (other[0].brief or other[0].values == last)
    return (skips_one and agree(one[1:], other, last)) or (skips_other and agree(one, other[1:], last))


def heartbeats(rows: Rows, end_ms: float) -> list[State]:
    """(custom mode, base mode, status). With offboard's base mode, PX4 sometimes leaves out one flag while it is disarmed."""
    beats = of_kind(rows, "heartbeat")
    plain = [[ms, kind, mode, base | 0x10 if mode == 6 << 16 else base, status] for ms, kind, mode, base, status in beats]
    return states(plain, BEAT_MS, end_ms)


def modes(rows: Rows, end_ms: float) -> list[State]:
    """CURRENT_MODE: (custom mode, intended, standard mode)."""
    return states(of_kind(rows, "mode"), 2.0 * BEAT_MS, end_ms)


def landed(rows: Rows, end_ms: float) -> list[State]:
    """EXTENDED_SYS_STATE.landed_state."""
    return states(of_kind(rows, "landed"), GRID_MS, end_ms)


def acks(rows: Rows) -> list[tuple[int, int]]:
    """(command, result) in the order of the commands; results of one command in their own order."""
    found = of_kind(rows, "ack")
    return [(row[2], row[3]) for row in sorted(found, key=lambda row: (row[2], row[0]))]


def events(rows: Rows) -> list[int]:
    """Numbers; immediate repetitions count once."""
    found = [row[2] for row in of_kind(rows, "event") if row[2] not in UNSTEADY_EVENTS]
    return [number for number, before in zip(found, [None, *found], strict=False) if number != before]


def texts(rows: Rows) -> list[str]:
    """Put together from their chunks, with their severity; numbers that depend on place and time left out."""
    whole: list[str] = []
    for _, _, severity, text, _, chunk in of_kind(rows, "text"):
        if chunk or (whole and whole[-1].endswith("health failures firs") and text.strip() == "t"):
            whole[-1] += text
        else:
            whole.append(f"{severity} {text}")
    plain = [re.sub(r"at \d+ m|\./log/\S+", "...", text) for text in whole]
    kept = [text for text in plain if not text[2:].startswith(UNSTEADY_TEXTS)]
    return [text for text, before in zip(kept, [None, *kept], strict=False) if text != before]


def increments(rows: Rows) -> list[int]:
    """Of the count of the filter's resets."""
    return [(after[2] - before[2]) % 256 for before, after in pairwise(of_kind(rows, "resets"))]


def first_after(rows: Rows, since_ms: float, kind: str, *values: Any) -> float | None:
    """When a row of this kind that begins with these values came first, at ``since_ms`` or later."""
    wanted = [kind, *values]
    return next((row[0] for row in rows if row[0] >= since_ms and row[1 : 1 + len(wanted)] == wanted), None)


def commands(rows: Rows, number: int, *parameters: float) -> Iterator[float]:
    """When a command was sent."""
    for row in of_kind(rows, "command"):
        if row[2] == number and row[3][: len(parameters)] == list(parameters):
            yield row[0]
