"""Base class of all sections of configuration files, and the types of their values, with limits."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

Positive = Annotated[float, Meta(gt=0.0, le=1e6)]
Activity = Annotated[float, Meta(gt=0.0, le=1e15)]
NonNegative = Annotated[float, Meta(ge=0.0, le=1e6)]
Coordinate = Annotated[float, Meta(ge=-1e5, le=1e5)]
Degrees = Annotated[float, Meta(ge=-360.0, le=360.0)]


class Section(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all sections: a key that is not known is an error, not a default."""
