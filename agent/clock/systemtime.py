"""The autopilot's time, overheard on a link that nobody uses: SYSTEM_TIME
(https://mavlink.io/en/messages/common.html#SYSTEM_TIME).

PX4 sends it once a second to an onboard computer, and only while its own clock shows a year after 2000 (its sources,
``streams/SYSTEM_TIME.hpp``): it gets the time from the satellites, or from a ground station.
"""

from __future__ import annotations

import struct

from agent.vehicle.signed import overhear

WAIT_S = 3.0  # three messages
_FIRST, _SECOND = 0xFE, 0xFD  # versions of MAVLink, by the first byte of a message
_SYSTEM_TIME, _CRC_EXTRA, _PAYLOAD_BYTES = 2, 137, 12
_AUTOPILOT = 1  # component
_CRC_BYTES = 2
_MOST_BYTES = 10 + _PAYLOAD_BYTES + _CRC_BYTES


async def overheard_time(address: str, system_id: int | None, source: str | None, wait_s: float = WAIT_S) -> int | None:
    """UTC by the autopilot's clock when this returns, in nanoseconds; None: it has not told it. Nothing is sent. Arguments
    and errors: see ``agent.vehicle.signed.first_message``.
    """
    return await overhear(address, lambda data, _: time_in(data, system_id), source, wait_s)


def time_in(data: bytes, system_id: int | None = None) -> int | None:
    """The newest time that an autopilot tells in these bytes, UTC in nanoseconds; None: it tells none. Checksums are verified."""
    for first_byte in (_SECOND, _FIRST):
        place = len(data)
        while (place := data.rfind(first_byte, 0, place)) >= 0:
            told_ns = _told_at(data[place : place + _MOST_BYTES], system_id)
            if told_ns is not None:
                return told_ns
    return None


def _told_at(data: bytes, system_id: int | None) -> int | None:
    """The time in the SYSTEM_TIME with which these bytes begin."""
    header = 10 if data[0] == _SECOND else 6  # bytes before the payload
    if len(data) < header:
        return None
    end = header + data[1]
    sender, component = data[header - 5 : header - 3] if data[0] == _SECOND else data[3:5]
    number = int.from_bytes(data[7:10], "little") if data[0] == _SECOND else data[5]
    if number != _SYSTEM_TIME or component != _AUTOPILOT or system_id not in (None, sender) or data[1] > _PAYLOAD_BYTES:
        return None
    if data[end : end + _CRC_BYTES] != struct.pack("<H", _checksum(data[1:end] + bytes([_CRC_EXTRA]))):
        return None
    unix_us, _ = struct.unpack("<QI", data[header:end].ljust(_PAYLOAD_BYTES, b"\0"))  # zeros at the end are not sent
    return int(unix_us) * 1000 or None


def _checksum(data: bytes) -> int:
    """MAVLink's, CRC-16/MCRF4XX (https://mavlink.io/en/guide/serialization.html#checksum)."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return crc
