"""Hypothesis strategies for valid messages, made from the schema itself."""

import math
from collections.abc import Callable
from typing import Any

import msgspec
from hypothesis import strategies as st
from msgspec import inspect

from radron.protocol.contamination import Block, Contamination, Range
from radron.protocol.entries import CarriedFrame, Cone, Exposure, Retraction, Sighting
from radron.protocol.messages import KINDS, AnyMessage, Frame, Plan, Source, Status

UNIT_BOUND = 1.000001  # of the components of unit vectors and quaternions


def messages(kind: str | None = None) -> st.SearchStrategy[AnyMessage]:
    """Valid messages of one kind, or of any."""
    if kind is None:
        return st.sampled_from(sorted(KINDS)).flatmap(messages)
    return _values(inspect.type_info(KINDS[kind]))


def _values(kind: inspect.Type) -> st.SearchStrategy[Any]:  # noqa: PLR0912 - a case for each type of field
    match kind:
        case inspect.StructType(cls=cls, fields=fields):
            made = st.fixed_dictionaries({field.name: _values(field.type) for field in fields})
            return made.map(lambda values: cls(**CONSISTENT.get(cls, dict)(values)))
        case inspect.TupleType(item_types=items):
            if isinstance(items[0], inspect.FloatType) and items[0].le == UNIT_BOUND:
                return st.tuples(*(st.floats(-1.0, 1.0) for _ in items)).map(normalised)
            return st.tuples(*(_values(item) for item in items))
        case inspect.VarTupleType(item_type=item, min_length=least, max_length=most):
            return st.lists(_values(item), min_size=least or 0, max_size=min(most or 5, max(least or 0, 5))).map(tuple)
        case inspect.DictType(key_type=key, value_type=value, min_length=least):
            return st.dictionaries(_values(key), _values(value), min_size=least or 0, max_size=5)
        case inspect.UnionType(types=types):
            return st.one_of(*(_values(part) for part in types))
        case inspect.FloatType(ge=low, le=high):
            return st.floats(low, high)
        case inspect.IntType(ge=low, le=high):
            return st.integers(low, high)
        case inspect.StrType(pattern=pattern) if pattern is not None:
            return st.from_regex(pattern)
        case inspect.StrType(max_length=most):
            return st.text(st.characters(exclude_categories=["Cs"]), max_size=most)
        case inspect.BytesType(min_length=least, max_length=most):
            return st.binary(min_size=least or 0, max_size=most)
        case inspect.EnumType(cls=cls):
            return st.sampled_from(cls)
        case inspect.BoolType():
            return st.booleans()
        case inspect.NoneType():
            return st.none()
    raise NotImplementedError(kind)


def normalised(vector: tuple[float, ...]) -> tuple[float, ...]:
    norm = math.hypot(*vector)
    return tuple(x / norm for x in vector) if norm > 1e-3 else (1.0,) + (0.0,) * (len(vector) - 1)


def _ordered(values: dict[str, Any]) -> dict[str, Any]:
    """An exposure that ends after its beginning, with its poses and its spectrum in order, and its counts in channels."""
    poses = sorted({pose.offset_ns: pose for pose in values["poses"]}.values(), key=lambda pose: pose.offset_ns)
    stamp = min(values["stamp_ns"], 2**63 - 1 - 120_000_000_000)
    duration = max(poses[-1].offset_ns, 1)
    live = min(values["live_time_s"], duration * 1e-9)
    bins = sorted({one.place: one for one in values["spectrum"]}.values(), key=lambda one: one.place)
    placed = {"stamp_ns": stamp, "end_ns": stamp + duration, "poses": tuple(poses), "live_time_s": live}
    return {**values, **placed, "spectrum": tuple(bins), "bins": (values["counts"].hits,)}


def _shared(values: dict[str, Any]) -> dict[str, Any]:
    """A cone with two probabilities that add up to one."""
    first, second = values["orders"]
    return {**values, "orders": (first, msgspec.structs.replace(second, probability=1.0 - first.probability))}


def _flyable(values: dict[str, Any]) -> dict[str, Any]:
    """A plan shrunk about the origin until 200 m/s are enough."""
    share = min(1.0, 200.0 * values["step_ns"] * 1e-9 / 4e5)
    return {**values, "positions_m": tuple(tuple(share * x for x in place) for place in values["positions_m"])}


def _of_another(values: dict[str, Any]) -> dict[str, Any]:
    """A sighting of another drone, with direction, range, or both, each with its error."""
    target = values["target"] if values["target"] != values["drone"] else values["drone"][:31] + "0"
    target = target if target != values["drone"] else values["drone"][:31] + "1"
    seen = {**values, "target": target}
    for thing, error in (("direction", "direction_sigma_rad"), ("range_m", "range_sigma_m")):
        if seen[thing] is None or seen[error] is None:
            seen[thing] = seen[error] = None
    return seen if seen["direction"] or seen["range_m"] is not None else {**seen, "range_m": 1.0, "range_sigma_m": 0.1}


def _of_before(values: dict[str, Any]) -> dict[str, Any]:
    """A retraction of entries with lower numbers than its own."""
    first, last = sorted(min(values[name], 2**40 - 1) for name in ("first", "last"))
    return {**values, "first": first, "last": last, "sequence": max(values["sequence"], last + 1)}


def _product(numbers: tuple[float, ...], size: int) -> list[list[float]]:
    """The covariance v v^T + 1 of a vector."""
    v = [max(-1e5, min(1e5, number)) for number in numbers[:size]]
    return [[v[i] * v[j] + (i == j) for j in range(size)] for i in range(size)]


def _unsure_frame(values: dict[str, Any]) -> dict[str, Any]:
    return {**values, "covariance": tuple(x for row in _product(values["covariance"], 4) for x in row)}


def _carried_frame(values: dict[str, Any]) -> dict[str, Any]:
    return values if values["covariance"] is None else _unsure_frame(values)


def _unsure_source(values: dict[str, Any]) -> dict[str, Any]:
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = _product(values["covariance_m2"], 3)
    return {**values, "covariance_m2": (xx, xy, xz, yy, yz, zz)}


def _labelled(values: dict[str, Any]) -> dict[str, Any]:
    """A status with as many codes as texts."""
    codes, lists = values["codes"], ("problems", "notices")
    counts = {name: min(len(values[name]), len(getattr(codes, name))) for name in lists}
    codes = msgspec.structs.replace(codes, **{name: getattr(codes, name)[: counts[name]] for name in lists})
    finding = "" if codes.finding is None else values["finding"] or "nothing found"
    return {**values, **{name: values[name][: counts[name]] for name in lists}, "finding": finding, "codes": codes}


def _ascending(values: dict[str, Any]) -> dict[str, Any]:
    return dict(zip(("low", "median", "high"), sorted(values.values()), strict=True))


def _whole_rows(values: dict[str, Any]) -> dict[str, Any]:
    return {**values, "across": 1 if len(values["blocks"]) % values["across"] else values["across"]}


CONSISTENT: dict[type, Callable[[dict[str, Any]], dict[str, Any]]] = {
    Block: _ascending,
    CarriedFrame: _carried_frame,
    Cone: _shared,
    Contamination: _whole_rows,
    Exposure: _ordered,
    Frame: _unsure_frame,
    Plan: _flyable,
    Range: _ascending,
    Retraction: _of_before,
    Sighting: _of_another,
    Source: _unsure_source,
    Status: _labelled,
}


def document(message: AnyMessage) -> dict[str, Any]:
    """The map that goes on the wire."""
    fields: dict[str, Any] = msgspec.to_builtins(message, builtin_types=(bytes,))
    return fields
