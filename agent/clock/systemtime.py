"""The autopilot's time, overheard on an unused link: SYSTEM_TIME (https://mavlink.io/en/messages/common.html#SYSTEM_TIME).

PX4 sends it once a second to an onboard computer, and only while its own clock shows a year after 2000 (its sources,
``streams/SYSTEM_TIME.hpp``): it gets the time from the satellites, or from a ground station.
"""

from __future__ import annotations

import struct

from radron.agent.vehicle.mavlink.header import AUTOPILOT, FIRST_BYTES, header_at
from radron.agent.vehicle.mavlink.overhearing import overhear

WAIT_S = 3.0  # three messages
_SYSTEM_TIME, _CRC_EXTRA, _PAYLOAD_BYTES = 2, 137, 12


async def overheard_time(address: str, system_id: int | None, source: str | None, wait_s: float = WAIT_S) -> int | None:
    """Return the present time (UTC, ns) by the autopilot's clock, from its messages; None: not received. Nothing is sent.

    Args:
        address, source, wait_s: see ``overhear``.
        system_id: of the vehicle; None: any.

    Raises:
        VehicleError: ``source`` is no IPv4 address.
    """
    return await overhear(address, lambda data, _: time_in(data, system_id), source, wait_s)


def time_in(data: bytes, system_id: int | None = None) -> int | None:
    """Return the newest time (UTC, ns) of an autopilot in bytes from its link; None without one. Checksums are verified."""
    for first_byte in FIRST_BYTES:
        place = len(data)
        while (place := data.rfind(first_byte, 0, place)) >= 0:
            told_ns = _told_at(data, place, system_id)
            if told_ns is not None:
                return told_ns
    return None


def _told_at(data: bytes, place: int, system_id: int | None) -> int | None:
    """The time in the SYSTEM_TIME that begins at this index."""
    header = header_at(data, place)
    if header is None or header.number != _SYSTEM_TIME:
        return None
    (system, component), payload = header.sender, data[header.payload]
    if component != AUTOPILOT or system_id not in (None, system) or len(payload) > _PAYLOAD_BYTES:
        return None
    checksum = data[header.payload.stop : header.payload.stop + 2]
    if checksum != struct.pack("<H", _checksum(data[place + 1 : header.payload.stop] + bytes([_CRC_EXTRA]))):
        return None
    unix_us, _ = struct.unpack("<QI", payload.ljust(_PAYLOAD_BYTES, b"\0"))  # zeros at the end are not sent
    return int(unix_us) * 1000 or None


def _checksum(data: bytes) -> int:
    """MAVLink's, CRC-16/MCRF4XX (https://mavlink.io/en/guide/serialization.html#checksum)."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return crc
