"""Hypothesis strategies for valid messages, made from the schema itself."""

import math
from typing import Any

import msgspec
from hypothesis import strategies as st
from msgspec import inspect

from protocol.messages import KINDS, AnyMessage, Exposure

_UNIT_BOUND = 1.000001  # of the components of unit vectors and quaternions


def messages(kind: str | None = None) -> st.SearchStrategy[AnyMessage]:
    """Valid messages of one kind, or of any."""
    if kind is None:
        return st.sampled_from(sorted(KINDS)).flatmap(messages)
    return _values(inspect.type_info(KINDS[kind]))


def _values(kind: inspect.Type) -> st.SearchStrategy[Any]:  # noqa: PLR0912 - a case for each type of field
    match kind:
        case inspect.StructType(cls=cls, fields=fields):
            made = st.fixed_dictionaries({field.name: _values(field.type) for field in fields})
            return made.map(lambda values: cls(**(_ordered(values) if cls is Exposure else values)))
        case inspect.TupleType(item_types=items):
            if isinstance(items[0], inspect.FloatType) and items[0].le == _UNIT_BOUND:
                return st.tuples(*(st.floats(-1.0, 1.0) for _ in items)).map(_normalised)
            return st.tuples(*(_values(item) for item in items))
        case inspect.VarTupleType(item_type=item, min_length=least, max_length=most):
            return st.lists(_values(item), min_size=least or 0, max_size=min(most or 5, max(least or 0, 5))).map(tuple)
        case inspect.DictType(key_type=key, value_type=value):
            return st.dictionaries(_values(key), _values(value), max_size=5)
        case inspect.UnionType(types=types):
            return st.one_of(*(_values(part) for part in types))
        case inspect.FloatType(ge=low, le=high) if low == -1e12 and high == 1e12:
            return st.floats(0.0, 1e12)  # variances: those on the diagonal must not be negative
        case inspect.FloatType(ge=low, le=high):
            return st.floats(low, high)
        case inspect.IntType(ge=low, le=high):
            return st.integers(low, high)
        case inspect.StrType(pattern=pattern) if pattern is not None:
            return st.from_regex(pattern)
        case inspect.StrType(max_length=most):
            return st.text(st.characters(exclude_categories=["Cs"]), max_size=most)
        case inspect.BytesType(max_length=most):
            return st.binary(max_size=most)
        case inspect.EnumType(cls=cls):
            return st.sampled_from(cls)
        case inspect.NoneType():
            return st.none()
    raise NotImplementedError(kind)


def _normalised(vector: tuple[float, ...]) -> tuple[float, ...]:
    norm = math.hypot(*vector)
    return tuple(x / norm for x in vector) if norm > 1e-3 else (1.0,) + (0.0,) * (len(vector) - 1)


def _ordered(values: dict[str, Any]) -> dict[str, Any]:
    """An exposure that ends after its beginning, with its poses in order inside of it."""
    poses = sorted({pose.offset_ns: pose for pose in values["poses"]}.values(), key=lambda pose: pose.offset_ns)
    stamp = min(values["stamp_ns"], 2**63 - 1 - 120_000_000_000)
    duration = poses[-1].offset_ns + 1
    live = min(values["live_time_s"], duration * 1e-9)
    return {**values, "stamp_ns": stamp, "end_ns": stamp + duration, "poses": tuple(poses), "live_time_s": live}


def document(message: AnyMessage) -> dict[str, Any]:
    """The map that goes on the wire."""
    fields: dict[str, Any] = msgspec.to_builtins(message, builtin_types=(bytes,))
    return fields
