"""MAVLink packets as in MAVSDK's MavlinkDirect: the fields by name as JSON, NaN as null, and no empty ends of strings."""

from __future__ import annotations

import json
import struct
from math import isfinite
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

EVENT_ID = 410
HEAD_BYTES, CHECKSUM_BYTES = 10, 2
_EVENT = struct.Struct("<IIHBBB40s")


def fields_of(packet: bytes) -> tuple[str, str] | None:
    """Name and fields (JSON) of a MAVLink 2 packet; None if unknown here."""
    if int.from_bytes(packet[7:10], "little") == EVENT_ID:
        return "EVENT", _event(packet)
    try:
        message = mavlink.MAVLink(None).decode(bytearray(packet))
    except mavlink.MAVError:
        return None
    fields = {name: _value(getattr(message, name)) for name in message.get_fieldnames()}
    return message.get_type(), json.dumps(fields)


def _event(packet: bytes) -> str:
    """EVENT, which pymavlink's dialects lack."""
    payload = packet[HEAD_BYTES : HEAD_BYTES + packet[1]].ljust(_EVENT.size, b"\0")
    number, _, sequence, component, system, levels, arguments = _EVENT.unpack(payload)
    fields = {"id": number, "sequence": sequence, "destination_component": component, "destination_system": system}
    return json.dumps(fields | {"log_levels": levels, "arguments": list(arguments)})


def _value(value: Any) -> Any:
    if isinstance(value, float):
        return value if isfinite(value) else None
    if isinstance(value, bytes):
        return value.decode(errors="replace").rstrip("\0")
    if isinstance(value, list | tuple | bytearray):
        return [_value(one) for one in value]
    return value.rstrip("\0") if isinstance(value, str) else value
