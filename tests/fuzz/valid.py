"""Valid messages of every kind, made from the schema itself: random numbers within their bounds, and the bounds themselves."""

from __future__ import annotations

from functools import lru_cache
from random import Random
from typing import Any

from msgspec import inspect

from radron.protocol.messages import KINDS
from support.flights.schema_messages import CONSISTENT, UNIT_BOUND, document, normalised

_TEXTS = {  # of the patterns of radron.protocol.units, by a part of them
    "0-9]{1,3}m?": ("Cs-137", "Co-60", "Am-241", "Ba-133", "Zz-999m"),
    "{32}": ("0" * 32, "f" * 32, "0123456789abcdef" * 2),
    "{16}": ("0" * 16, "f" * 16, "0123456789abcdef"),
    "{0,48}": ("", "low-battery", "x" * 48),
    "{0,31}": ("d1", "d2", "d3", "a", "x" * 32, "bayes", "0"),
}


@lru_cache
def documents(each: int, seed: int = 0) -> dict[str, list[dict[str, Any]]]:
    """``each`` valid documents of every kind: half with numbers of any size, half with such as a swarm may have in its area."""
    rng = Random(seed)
    return {
        kind: [document(_value(rng, inspect.type_info(cls), rng.random() < 0.5)) for _ in range(each)]
        for kind, cls in sorted(KINDS.items())
    }


def _value(rng: Random, kind: inspect.Type, tame: bool) -> Any:  # noqa: PLR0912 - a case for each type of field
    match kind:
        case inspect.StructType(cls=cls, fields=fields):
            values = {field.name: _value(rng, field.type, tame) for field in fields}
            return cls(**CONSISTENT.get(cls, dict)(values))
        case inspect.TupleType(item_types=items):
            if isinstance(items[0], inspect.FloatType) and items[0].le == UNIT_BOUND:
                return normalised(tuple(rng.uniform(-1.0, 1.0) for _ in items))
            return tuple(_value(rng, item, tame) for item in items)
        case inspect.VarTupleType(item_type=item, min_length=least, max_length=most):
            sizes = [size for size in (0, 1, 2, 9, 16, 32, most or 0) if (least or 0) <= size <= (most or 9)]
            return tuple(_value(rng, item, tame) for _ in range(rng.choice(sizes)))
        case inspect.DictType(key_type=inspect.EnumType(cls=cls), value_type=value):
            return {one: _value(rng, value, tame) for one in cls if rng.random() < 0.5}
        case inspect.DictType(key_type=key, value_type=value):
            return {f"{_value(rng, key, tame)}{place}"[-64:]: _value(rng, value, tame) for place in range(rng.randrange(4))}
        case inspect.UnionType(types=types):
            return _value(rng, rng.choice(types), tame)
        case inspect.FloatType(ge=low, le=high):
            assert low is not None
            assert high is not None
            near = rng.uniform(max(low, -50.0), min(high, 50.0))
            return near if tame else float(rng.choice((rng.uniform(low, high), near, low, high)))
        case inspect.IntType(ge=low, le=high):
            assert low is not None
            assert high is not None
            return rng.choice((rng.randint(low, high), rng.randint(low, min(low + 100, high)), low, high))
        case inspect.StrType(pattern=pattern) if pattern is not None:
            return next(rng.choice(texts) for part, texts in _TEXTS.items() if part in pattern)
        case inspect.StrType(max_length=most):
            return "".join(rng.choice("a \u00e9\u4e16\U0001f4a5\n") for _ in range(rng.choice((0, 3, most or 0))))
        case inspect.BytesType(min_length=least, max_length=most):
            return rng.randbytes(rng.choice([size for size in (0, 3, most or 0) if size >= (least or 0)]))
        case inspect.EnumType(cls=cls):
            return rng.choice(list(cls))
        case inspect.BoolType():
            return rng.random() < 0.5
        case inspect.NoneType():
            return None
    raise NotImplementedError(kind)
