"""Every number has limits (so NaN and infinity never pass), every text and list a maximum length."""

from collections.abc import Iterator

import msgspec
import pytest
from msgspec import inspect

from radron.protocol.messages import KINDS


def parts(kind: inspect.Type, where: str) -> Iterator[tuple[str, inspect.Type]]:
    """The type and all types inside it, with their places."""
    yield where, kind
    match kind:
        case inspect.StructType(fields=fields):
            for field in fields:
                yield from parts(field.type, f"{where}.{field.name}")
        case inspect.TupleType(item_types=items) | inspect.UnionType(types=items):
            for number, item in enumerate(items):
                yield from parts(item, f"{where}[{number}]")
        case inspect.VarTupleType(item_type=item) | inspect.ListType(item_type=item):
            yield from parts(item, f"{where}[]")
        case inspect.DictType(key_type=key, value_type=value):
            yield from parts(key, f"{where}.keys")
            yield from parts(value, f"{where}.values")


ALL_PARTS = [part for kind, message in KINDS.items() for part in parts(inspect.type_info(message), kind)]


def test_the_walk_sees_the_numbers_inside() -> None:
    places = {where for where, _ in ALL_PARTS}
    assert {"cone.orders[1].theta_rad", "exposure.poses[].position_m[2]", "status.counters.values"} <= places


@pytest.mark.parametrize(("where", "kind"), ALL_PARTS, ids=[where for where, _ in ALL_PARTS])
def test_bounded(where: str, kind: inspect.Type) -> None:
    match kind:
        case inspect.FloatType() | inspect.IntType():
            assert kind.ge is not None or kind.gt is not None
            assert kind.le is not None or kind.lt is not None
        case inspect.StrType():
            assert kind.max_length is not None or kind.pattern is not None
        case inspect.BytesType() | inspect.VarTupleType() | inspect.DictType():
            assert kind.max_length is not None
        case _:
            parts = inspect.StructType | inspect.TupleType | inspect.UnionType
            closed = parts | inspect.EnumType | inspect.BoolType | inspect.NoneType
            assert isinstance(kind, closed), f"{where}: {kind} has no limits that this test knows"


def test_every_kind_names_its_type() -> None:
    for kind, message in KINDS.items():
        info = inspect.type_info(message)
        assert isinstance(info, inspect.StructType)
        assert (info.tag_field, info.tag) == ("kind", kind)
        assert not msgspec.structs.fields(message)[0].name.startswith("_")
