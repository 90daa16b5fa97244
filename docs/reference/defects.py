"""The tables of defects on the page of the campaigns with faults, made from ``docs/defects.toml``."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Literal, get_args

import msgspec

SOURCE = Path(__file__).parents[1] / "defects.toml"

Kind = Literal[
    "link",
    "restart",
    "clock",
    "localisation",
    "pilot",
    "revocation",
    "member",
    "autopilot",
    "avoidance",
    "camera",
    "computer",
    "estimate",
    "simulation",
]
Status = Literal["open", "accepted", "fixed"]

_MARK = re.compile(r"<!-- defects: (\w+) -->")
_HEAD = "| Defect | Kind | Cause and effect | Missions | Fix | Test |\n|---|---|---|---|---|---|\n"


class Defect(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A row of ``docs/defects.toml``, whose first lines describe the fields."""

    id: Annotated[str, msgspec.Meta(pattern="^[a-z0-9]+(-[a-z0-9]+)*$")]
    kind: Kind
    status: Status
    seeds: tuple[int, ...]
    what: Annotated[str, msgspec.Meta(min_length=1)]
    fix: str
    test: str


class _File(msgspec.Struct, forbid_unknown_fields=True):
    defect: tuple[Defect, ...]


def defects() -> tuple[Defect, ...]:
    """Return the rows in the order of the file. Raise ``msgspec.ValidationError`` for an unknown field, kind or status."""
    return msgspec.toml.decode(SOURCE.read_bytes(), type=_File).defect


def with_tables(markdown: str) -> str:
    """Return a page with the table of a status in place of each ``<!-- defects: STATUS -->``."""
    return _MARK.sub(lambda mark: _table(each for each in defects() if each.status == mark[1]), markdown)


def _table(rows: Iterable[Defect]) -> str:
    kinds = get_args(Kind)
    return _HEAD + "\n".join(map(_row, sorted(rows, key=lambda defect: kinds.index(defect.kind))))


def _row(defect: Defect) -> str:
    link = f'<a id="{defect.id}"></a>[{defect.id}](#{defect.id})'
    test = f"`{defect.test}`" if defect.test else ""
    cells = (link, defect.kind, defect.what, ", ".join(map(str, defect.seeds)), defect.fix, test)
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"
