"""Turns configuration and message types into Markdown: a section for each type, a row for each field.

All that is told comes from the code: names, types, limits and defaults from the msgspec types, meanings from their docstrings and
from the comment that stands behind a field.
"""

from __future__ import annotations

import ast
import inspect
import io
import re
import textwrap
import tokenize
from collections.abc import Iterator
from enum import Enum
from functools import cache
from typing import NamedTuple

import msgspec
from msgspec.inspect import Field, StructType, Type

# The end of a field's name, longest first.
UNITS = {
    "m2ps": "m²/s",
    "mps3": "m/s³",
    "mps2": "m/s²",
    "mps": "m/s",
    "degpm": "°/m",
    "rps": "rad/s",
    "ps": "1/s",
    "per_s": "1/s",
    "per_m": "1/m",
    "kev": "keV",
    "deg": "°",
    "rad": "rad",
    "bq": "Bq",
    "mb": "MB",
    "mm": "mm",
    "m2": "m²",
    "m": "m",
    "ns": "ns",
    "s": "s",
    "v": "V",
}
PATTERNS = {  # regular expressions of the protocol, in words
    "[A-Z][a-z]?-": "nuclide, such as `Cs-137`",
    "[0-9a-f]{16}": "16 hex digits",
    "[0-9a-f]{32}": "32 hex digits",
    "[a-z0-9][a-z0-9-]{0,31}": "name of up to 32 of `a-z`, `0-9`, `-`",
    "mission|EPSG": "`mission` or an EPSG code",
    "[a-z0-9-]{0,48}": "[code](codes.md)",
}


class Section(NamedTuple):
    """A type as it is reached in a file or message: the path of keys; ``drones[]`` is a list, ``vehicles.ID`` a table by name."""

    path: str
    kind: type[msgspec.Struct]
    fields: tuple[Field, ...]


def sections(kind: type[msgspec.Struct], path: str = "", leave_out: tuple[type, ...] = ()) -> Iterator[Section]:
    """A type and all the struct types within it, the outer ones first; ``leave_out``: not looked into."""
    info = msgspec.inspect.type_info(kind)
    assert isinstance(info, StructType)
    yield Section(path, kind, info.fields)
    for field in info.fields:
        for inner, suffix in structs(field.type):
            if inner.cls not in leave_out:
                yield from sections(inner.cls, f"{path}.{field.encode_name}{suffix}".lstrip("."), leave_out)


def structs(kind: Type, suffix: str = "") -> Iterator[tuple[StructType, str]]:
    """The struct types in a field's type, with what follows the key to get there."""
    if isinstance(kind, StructType):
        yield kind, suffix
    elif isinstance(kind, msgspec.inspect.UnionType):
        for option in kind.types:
            yield from structs(option, suffix)
    elif isinstance(kind, msgspec.inspect.DictType):
        yield from structs(kind.value_type, f"{suffix}.ID")
    elif isinstance(kind, msgspec.inspect.VarTupleType | msgspec.inspect.ListType):
        yield from structs(kind.item_type, f"{suffix}[]")
    elif isinstance(kind, msgspec.inspect.TupleType):
        seen: list[type] = []
        for item in kind.item_types:
            if isinstance(item, StructType) and item.cls not in seen:
                seen.append(item.cls)
                yield item, f"{suffix}[]"


def table(section: Section) -> str:
    """The rows of a type's fields."""
    comments = field_comments(section.kind)
    rows = ["| key | type | unit | default | meaning |", "|---|---|---|---|---|"]
    for field in section.fields:
        name = field.encode_name
        cells = (f"`{name}`", type_text(field.type), unit_of(name), default_text(field), markdown_line(comments.get(name, "")))
        rows.append(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |")
    return "\n".join(rows)


def unit_of(name: str) -> str:
    """The unit that a field's name ends with; empty if it names none."""
    for ending, unit in UNITS.items():
        if name.endswith(f"_{ending}"):
            return unit
    return ""


def type_text(kind: Type) -> str:
    """A type with its limits, in words."""
    match kind:
        case msgspec.inspect.IntType() | msgspec.inspect.FloatType():
            return f"{'integer' if isinstance(kind, msgspec.inspect.IntType) else 'number'}{_limits(kind)}"
        case msgspec.inspect.StrType():
            named = next((words for part, words in PATTERNS.items() if kind.pattern and part in kind.pattern), "text")
            return f"{named}{_lengths(kind.min_length, kind.max_length, 'characters')}"
        case msgspec.inspect.BytesType():
            return f"bytes{_lengths(kind.min_length, kind.max_length, 'long')}"
        case msgspec.inspect.BoolType():
            return "`true` or `false`"
        case msgspec.inspect.NoneType():
            return "nothing"
        case msgspec.inspect.LiteralType():
            return ", ".join(f"`{value}`" for value in kind.values)
        case msgspec.inspect.EnumType():
            return f"[{kind.cls.__name__}](#{kind.cls.__name__.lower()})"
        case StructType():
            return f"[{kind.cls.__name__}](#{kind.cls.__name__.lower()})"
        case msgspec.inspect.UnionType():
            return " or ".join(type_text(option) for option in kind.types if not isinstance(option, msgspec.inspect.NoneType))
        case msgspec.inspect.VarTupleType() | msgspec.inspect.ListType():
            return f"list{_lengths(kind.min_length, kind.max_length, 'items')} of: {type_text(kind.item_type)}"
        case msgspec.inspect.TupleType():
            return _tuple_text(kind)
        case msgspec.inspect.DictType():
            return (
                f"table{_lengths(None, kind.max_length, 'entries')} by {type_text(kind.key_type)}: {type_text(kind.value_type)}"
            )
    raise TypeError(f"no words for {kind!r}")  # a type that is new here needs its case above


def _tuple_text(kind: msgspec.inspect.TupleType) -> str:
    texts = [type_text(item) for item in kind.item_types]
    if len(set(texts)) == 1:
        return f"list of {len(texts)}: {texts[0]}"
    return f"list of {len(texts)}: {'; '.join(texts)}"


def _limits(kind: msgspec.inspect.IntType | msgspec.inspect.FloatType) -> str:
    low = f"{_number(kind.gt)} < " if kind.gt is not None else f"{_number(kind.ge)} ≤ " if kind.ge is not None else ""
    high = f" < {_number(kind.lt)}" if kind.lt is not None else f" ≤ {_number(kind.le)}" if kind.le is not None else ""
    return f", {low}x{high}" if low or high else ""


def _lengths(least: int | None, most: int | None, what: str) -> str:
    if least is None and most is None:
        return ""
    return f" ({f'up to {most}' if least is None else f'at least {least}' if most is None else f'{least} to {most}'} {what})"


def _number(value: float) -> str:
    for bits in range(31, 64):
        if value in (2**bits, 2**bits - 1, -(2**bits)):
            return f"{'-' if value < 0 else ''}2^{bits}{' - 1' if value == 2**bits - 1 else ''}"
    return str(value) if isinstance(value, int) and abs(value) < 10**7 else f"{value:g}"


def default_text(field: Field) -> str:
    """A field's default; ``required`` where there is none, and nothing for a table whose keys have their own."""
    if field.required:
        return "**required**"
    if field.default is field.default_factory is msgspec.NODEFAULT:
        return "left out"
    default = field.default if field.default is not msgspec.NODEFAULT else field.default_factory()
    if default is None:
        return "none"
    if isinstance(default, msgspec.Struct):
        return ""
    return f"`{_plain(default)}`"


def _plain(value: object) -> str:
    match value:
        case Enum():
            return str(value.value)
        case bool():
            return str(value).lower()
        case float():
            return f"{value:g}"
        case str():
            return f'"{value}"'
        case tuple() | list():
            return f"[{', '.join(map(_plain, value))}]"
        case dict():
            return "{}" if not value else str(value)
    return str(value)


@cache
def field_comments(kind: type) -> dict[str, str]:
    """The comments behind a type's fields, those of its bases included."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        if base.__module__.startswith("radron."):
            found |= _own_comments(base)
    return found


def _own_comments(kind: type) -> dict[str, str]:
    source = textwrap.dedent(inspect.getsource(kind))
    comments = {
        token.start[0]: token.string.lstrip("# ")
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type == tokenize.COMMENT
    }
    fields = [node for node in ast.parse(source).body[0].body if isinstance(node, ast.AnnAssign)]  # type: ignore[attr-defined]
    named = ((node.target.id, node.end_lineno) for node in fields if isinstance(node.target, ast.Name))
    return {name: comments[line] for name, line in named if line in comments}


def markdown(docstring: str | None) -> str:
    """A docstring as Markdown: code in single backticks, indented listings of names as lists."""
    text = re.sub(r"``([^`]+)``", r"`\1`", inspect.cleandoc(docstring or ""))
    text = re.sub(r":(?:class|func|meth):`([^`]+)`", r"`\1`", text)
    lines: list[str] = []
    level = 0  # by which the present list is indented; 0: there is none
    for line in text.splitlines():
        indent = len(line) - len(line.lstrip())
        item = re.match(r"^ +([\w-]+(?:, [\w-]+)*): (.*)$", line) if not level or indent <= level else None
        if item:
            if not level and lines and lines[-1]:
                lines.append("")
            level = indent
            lines.append(f"- {', '.join(f'`{name}`' for name in item.group(1).split(', '))}: {item.group(2)}")
        elif level and indent > level:
            lines.append(f"  {line.strip()}")
        else:
            if level and line:
                level = 0
                if lines[-1]:
                    lines.append("")
            lines.append(line.strip() if indent else line)
    return "\n".join(lines)


def markdown_line(text: str) -> str:
    """A comment as Markdown: stars and less-than signs as they are."""
    return re.sub(r"([*<])", r"\\\1", text)
