"""The header of a MAVLink message in bytes that may begin and end anywhere
(https://mavlink.io/en/guide/serialization.html#packet_format).
"""

from __future__ import annotations

from typing import NamedTuple

AUTOPILOT = 1  # component
FIRST_BYTES = 0xFD, 0xFE  # of a message: MAVLink's second version, its first
_SECOND, _FIRST = FIRST_BYTES
_SECOND_HEADER, _FIRST_HEADER, _CRC_BYTES, _SIGNATURE_BYTES = 10, 6, 2, 13
_IS_SIGNED = 0x01  # of the incompatibility flags


class Header(NamedTuple):
    """The header of a MAVLink message, and the place of the message in the bytes that were read.

    ``sender``: system and component of the sender; ``number``: message id; ``payload``, ``end``: indices of the payload, and of
    the first byte after checksum and signature, which may both lie beyond the bytes at hand.
    """

    sender: tuple[int, int]
    number: int
    is_signed: bool
    payload: slice
    end: int


def header_at(data: bytes, place: int) -> Header | None:
    """Return the header of a MAVLink message that begins at this index of the bytes; None if none begins there, or it is not
    complete.
    """
    second = data[place] == _SECOND
    begin = place + (_SECOND_HEADER if second else _FIRST_HEADER)
    if data[place] not in FIRST_BYTES or len(data) < begin:
        return None
    payload = slice(begin, begin + data[place + 1])
    if not second:
        return Header((data[place + 3], data[place + 4]), data[place + 5], False, payload, payload.stop + _CRC_BYTES)
    is_signed, number = bool(data[place + 2] & _IS_SIGNED), int.from_bytes(data[place + 7 : place + 10], "little")
    end = payload.stop + _CRC_BYTES + _SIGNATURE_BYTES * is_signed
    return Header((data[place + 5], data[place + 6]), number, is_signed, payload, end)
