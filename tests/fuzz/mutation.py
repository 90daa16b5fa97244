"""Mutations of valid input: of its bytes, of its text, and of the document that the bytes stand for."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from random import Random
from typing import Any

HOSTILE_NUMBERS: tuple[float, ...] = (
    *(float("nan"), float("inf"), float("-inf"), 0, 0.0, -0.0, -1, 1, 0.5, 2, 5e-324, 1e-300, 1e-9, 1e5, -1e5, 1e6, 1e9),
    *(1e18, 1e300, -1e300, 1.7976931348623157e308, 127, 128, 255, 256, 2**15, 2**16, 2**31 - 1, 2**31, -(2**31), 2**32),
    *(2**53, 2**62, 2**63 - 1, 2**63, 2**64 - 1, -(2**63), 1_800_000_000_000_000_000),
)
HOSTILE_TEXTS = (
    *("", " ", "\0", "a", "d1", "d2", "station", "bayes", "paper", "nan", "1e999", "0x", "-", "/", "../..", "/dev/null", "."),
    *("\u00e9\u4e16\U0001f4a5", "\u202e", "a" * 33, "x" * 1025, "%s%n{}", "\n", "Cs-137", "exact", "0" * 16, "f" * 32),
)
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
_NUMBER_TEXTS = (
    *(b"nan", b"inf", b"-inf", b"+nan", b"0", b"-0", b"-1", b"1e999", b"-1e999", b"1e-999", b"9" * 20, b"9" * 400, b"1_000"),
    *(b"0x7fffffffffffffff", b"0b1", b"01", b"1.", b".5", b"1e", b"true", b'""', b'"1"', b"[]", b"{}", b"[[[]]]", b"null"),
    *(b"1979-05-27", b"2147483648", b"9223372036854775807", b"9223372036854775808", b"-9223372036854775809", b"65536", b"1e308"),
    *(b"72057594037927935", b"1099511627775", b"1073741823", b"16383", b"116", b"117"),
)
_LONG_NUMBER = b"9" * 5000  # longer than Python converts


def nested(depth: int, leaf: Any = 0) -> Any:
    """Lists in lists."""
    for _ in range(depth):
        leaf = [leaf]
    return leaf


def hostile(rng: Random) -> Any:
    """A value that hardly any field allows."""
    pick = rng.random()
    if pick < 0.6:
        return rng.choice(HOSTILE_NUMBERS)
    if pick < 0.8:
        return rng.choice(HOSTILE_TEXTS)
    if pick < 0.83:
        return nested(rng.choice((1, 2, 10, 100)), rng.choice(HOSTILE_NUMBERS))
    return rng.choice((True, False, [], {}, [0], [[]], {"a": 0}, [0.0] * 3, [0.0] * 4, [0] * 65, ["a"] * 3))


def mutated(rng: Random, value: Any, odd: Callable[[Random], Any] = hostile) -> Any:
    """A copy of a document with one value replaced, doubled, moved, renamed or left out somewhere in it. ``odd``: new values."""
    if isinstance(value, dict) and value:
        return _mutated_map(rng, value, odd)
    if isinstance(value, list | tuple) and value:
        return _mutated_list(rng, list(value), odd)
    if isinstance(value, bool) or not isinstance(value, int | float) or rng.random() < 0.6:
        return odd(rng)
    near = (-value, value + 1, value - 1, value * 2, value * 10, value * 1e-3, value + 0.5, value * 1e6, rng.uniform(-1e3, 1e3))
    return rng.choice(near)


def _mutated_map(rng: Random, value: dict[Any, Any], odd: Callable[[Random], Any]) -> dict[Any, Any]:
    copy, key, pick = dict(value), rng.choice(list(value)), rng.random()
    if pick < 0.75:
        copy[key] = mutated(rng, value[key], odd)
    elif pick < 0.82:
        del copy[key]
    elif pick < 0.88:
        copy[rng.choice(("x", f"{key}_", key.upper() if isinstance(key, str) else "y", *HOSTILE_TEXTS[3:6]))] = odd(rng)
    elif pick < 0.94:
        copy[key] = copy[rng.choice(list(value))]
    else:
        copy[key] = odd(rng)
    return copy


def _mutated_list(rng: Random, copy: list[Any], odd: Callable[[Random], Any]) -> list[Any]:
    place, pick = rng.randrange(len(copy)), rng.random()
    if pick < 0.75:
        copy[place] = mutated(rng, copy[place], odd)
    elif pick < 0.82:
        del copy[place]
    elif pick < 0.9:
        copy.insert(place, copy[rng.randrange(len(copy))])
    elif pick < 0.94:
        copy *= rng.choice((2, 2, 3, 30))
    elif pick < 0.97:
        copy.sort(key=repr)
    else:
        rng.shuffle(copy)
    return copy


def broken(rng: Random, data: bytes, others: Sequence[bytes] = ()) -> bytes:
    """The bytes with flips, cuts, copies, insertions, or parts of ``others``."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        _break(rng, out, others)
    return bytes(out)


def _break(rng: Random, out: bytearray, others: Sequence[bytes]) -> None:
    if not out:
        out += rng.randbytes(rng.randrange(1, 20))
        return
    pick, place = rng.random(), rng.randrange(len(out))
    length = min(rng.choice((1, 1, 2, 4, 8, 64, 1024)), len(out) - place)
    if pick < 0.4:
        out[place] ^= 1 << rng.randrange(8)
    elif pick < 0.55:
        out[place] = rng.choice((0, 1, 0x7F, 0x80, 0xFF, 0xC1, rng.randrange(256)))
    elif pick < 0.65:
        del out[place:]
    elif pick < 0.72:
        del out[place : place + length]
    elif pick < 0.8:
        out[place:place] = out[place : place + length]
    elif pick < 0.87:
        out[place:place] = rng.randbytes(length)
    elif pick < 0.94:
        out[place : place + length] = rng.choice((b"\0", b"\xff")) * length
    elif others:
        other = rng.choice(others)
        begin = rng.randrange(len(other) + 1)
        out[place : place + length] = other[begin : begin + length]


def broken_text(rng: Random, text: bytes) -> bytes:
    """A text with another number somewhere, or with lines that are lost, doubled, swapped or joined."""
    pick = rng.random()
    if pick < 0.5:
        numbers = list(_NUMBER.finditer(text))
        if numbers:
            found = rng.choice(numbers)
            odd = _LONG_NUMBER if rng.random() < 0.02 else rng.choice(_NUMBER_TEXTS)
            return text[: found.start()] + odd + text[found.end() :]
    if pick < 0.75:
        lines = text.split(b"\n")
        place, other = rng.randrange(len(lines)), rng.randrange(len(lines))
        change = rng.randrange(5)
        if change == 0:
            del lines[place]
        elif change == 1:
            lines.insert(other, lines[place])
        elif change == 2:
            lines[place], lines[other] = lines[other], lines[place]
        elif change == 3:
            lines[place] += lines[other]
        else:
            lines[place] = lines[place][: rng.randrange(len(lines[place]) + 1)]
        return b"\n".join(lines)
    return broken(rng, text)
