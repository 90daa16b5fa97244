"""MAVLink packets of real and emulated vehicles and of their companions, with other values in their fields."""

from __future__ import annotations

import struct
from functools import lru_cache
from math import isnan
from random import Random
from typing import Any

from pymavlink.dialects.v20 import common, development
from pymavlink.generator.mavcrc import x25crc

from support.px4.recorded import packets
from tests.fuzz.mutation import HOSTILE_NUMBERS

RECORDINGS = ("B_flight1", "D_gps_loss_5s_circling_r12_v3", "A_boot_gcs_wait")
HEAD_BYTES = 10
_CRC_EXTRA = {410: 160}  # EVENT, which pymavlink's dialects lack
_FLOATS = tuple(
    struct.pack("<f", value) for value in (float("nan"), float("inf"), float("-inf"), 3.4e38, -3.4e38, 1e-45, 0.0, 1e9)
)
_WORDS = (b"\0" * 8, b"\xff" * 8, b"\xff" * 7 + b"\x7f", b"\0" * 7 + b"\x80", b"\0\0\0\x80" * 2, b"\xff\xff\xff\x7f" * 2)


@lru_cache
def recorded() -> dict[int, list[bytes]]:
    """Packets of real autopilots by message id, at most 40 of each."""
    found: dict[int, list[bytes]] = {}
    for name in RECORDINGS:
        for packet in packets(name):
            kept = found.setdefault(number_of(packet.data), [])
            if packet.component == 1 and len(kept) < 40 and crc_extra(number_of(packet.data)) is not None:
                kept.append(packet.data)
    return {number: ones for number, ones in found.items() if ones}


def number_of(packet: bytes) -> int:
    """Its message id."""
    return int.from_bytes(packet[7:10], "little")


def crc_extra(number: int) -> int | None:
    """Of a message's layout; None for an unknown one."""
    known = development.mavlink_map.get(number)
    return _CRC_EXTRA.get(number) if known is None else int(known.crc_extra)


def odd_payload(rng: Random, packet: bytes) -> bytes:
    """The packet with other bytes in its payload, in some of them at the places of its numbers, and a checksum that fits."""
    payload = bytearray(packet[HEAD_BYTES : HEAD_BYTES + packet[1]])
    for _ in range(rng.choice((1, 1, 2, 4))):
        place = rng.randrange(max(1, len(payload)))
        pick = rng.random()
        if pick < 0.45:
            place -= place % 4
            payload[place : place + 4] = rng.choice(_FLOATS)
        elif pick < 0.65:
            length = rng.choice((1, 2, 4, 8))
            place -= place % length
            payload[place : place + length] = rng.choice(_WORDS)[:length]
        elif pick < 0.75:
            payload = bytearray(rng.choice((b"\0", b"\xff", rng.randbytes(1)))) * len(payload)
        elif pick < 0.8:
            payload = payload[:place]
        else:
            payload[place : place + 1] = rng.randbytes(1)
    return packed(packet, bytes(payload[:255]))


def packed(packet: bytes, payload: bytes) -> bytes:
    """The packet's head with another payload, zeros cut off its end as MAVLink 2 does, and its checksum."""
    payload = payload.rstrip(b"\0") or b"\0"
    head = bytes((packet[0], len(payload))) + packet[2:HEAD_BYTES]
    crc = x25crc(head[1:] + payload)
    crc.accumulate(bytes((crc_extra(number_of(packet)) or 0,)))
    return head + payload + struct.pack("<H", crc.crc)


def from_companion(rng: Random, kinds: tuple[str, ...], sender: common.MAVLink, target: int) -> bytes:
    """A message of one of these kinds from a companion, with random fields, mostly to that system."""
    kind = getattr(common, f"MAVLink_{rng.choice(kinds).lower()}_message")
    values = [
        _field(rng, name, type_name, kind.array_lengths[kind.ordered_fieldnames.index(name)], target)
        for name, type_name in zip(kind.fieldnames, kind.fieldtypes, strict=True)
    ]
    return bytes(kind(*values).pack(sender))


def _field(rng: Random, name: str, kind: str, length: int, target: int) -> Any:
    if name == "target_system":
        return rng.choice((target, target, target, target, 0, 9))
    if name == "target_component":
        return rng.choice((1, 1, 1, 1, 0, 195))
    if kind == "char":
        return rng.choice((b"MPC_XY_P", b"COM_RC_IN_MODE", b"SYS_AUTOSTART", b"", b"\xff\xfe", b"x" * 16, rng.randbytes(8)))[
            :length
        ]
    return [_number(rng, kind) for _ in range(length)] if length else _number(rng, kind)


def _number(rng: Random, kind: str) -> float:
    if kind in ("float", "double"):
        value = rng.choice((rng.uniform(-10.0, 10.0), rng.uniform(-1e3, 1e3), *HOSTILE_NUMBERS))
        return float(value) if kind == "double" or isnan(value) or abs(value) < 3.4e38 else float("inf")
    bits = int("".join(filter(str.isdigit, kind.removesuffix("_t"))))
    low, high = (0, 2**bits - 1) if kind.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return rng.choice((0, 1, low, high, rng.randint(low, high), min(high, rng.randrange(64))))
