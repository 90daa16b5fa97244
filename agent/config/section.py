"""Base class of all sections of configuration files, and the types of their values, with limits."""

from __future__ import annotations

from functools import cache
from typing import Annotated, ClassVar, Literal

from msgspec import NODEFAULT, Meta, Struct
from msgspec.structs import FieldInfo, fields

Positive = Annotated[float, Meta(gt=0.0, le=1e6)]
Activity = Annotated[float, Meta(gt=0.0, le=1e15)]
NonNegative = Annotated[float, Meta(ge=0.0, le=1e6)]
Coordinate = Annotated[float, Meta(ge=-1e5, le=1e5)]
FileName = Annotated[str, Meta(pattern=r"\A[^\x00-\x1f\x7f]+\Z")]  # no control characters: errors name it in one line
DetectorKind = Literal["minipix", "spectrum", "counts"]
Degrees = Annotated[float, Meta(ge=-360.0, le=360.0)]


class Section(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base class of all sections of configuration files: an unknown key is an error, not a default.

    ``later``: names of the keys added after version 2 of the protocol. With their defaults they are no part of a section's
    content, so that older missions keep their id, and their flight records stay readable.
    """

    later: ClassVar[frozenset[str]] = frozenset()


def content_of(section: Section) -> dict[str, object]:
    """Return the content from which a mission's id is computed: keys and values of a section, with all inner sections.

    Keys in ``later`` (added to the format afterwards) that have their default value are left out.
    """
    return {
        field.encode_name: _plain(getattr(section, field.name))
        for field in _fields(type(section))
        if field.name not in section.later or getattr(section, field.name) != _default(field)
    }


@cache
def _fields(kind: type[Section]) -> tuple[FieldInfo, ...]:
    """Cached: each message needs an id, and a class's fields take milliseconds to inspect."""
    return fields(kind)


def _plain(value: object) -> object:
    if isinstance(value, Section):
        return content_of(value)
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def _default(field: FieldInfo) -> object:
    return field.default_factory() if field.default_factory is not NODEFAULT else field.default
