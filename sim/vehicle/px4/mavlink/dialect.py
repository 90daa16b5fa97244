"""MAVLink messages that PX4 sends and pymavlink's ``common`` dialect lacks (from PX4's ``development`` and ``events``).

Written by hand in the form of pymavlink's own, so that its MAVLink objects pack them. EVENT, CURRENT_EVENT_SEQUENCE and
PROTOCOL_VERSION are in no dialect of pymavlink; the others are in ``development``, a second dialect of 200 messages.
"""

from __future__ import annotations

import struct
from typing import Any, ClassVar

from pymavlink.dialects.v20 import common as mavlink

ARGUMENTS = 40  # bytes of an event
_HEADER, _CHECKSUM = 10, 2


class _Message(mavlink.MAVLink_message):  # type: ignore[misc]  # pymavlink has no types
    """Base of these messages; ``wire`` is the order of the fields on the link, by size of their types."""

    id: ClassVar[int]
    msgname: ClassVar[str]
    wire: ClassVar[tuple[str, ...]]
    crc_extra: ClassVar[int]
    unpacker: ClassVar[struct.Struct]
    fieldnames: ClassVar[list[str]]

    def __init__(self, **fields: int | bytes) -> None:
        mavlink.MAVLink_message.__init__(self, self.id, self.msgname)
        self._fieldnames = list(self.wire)
        for name in self.wire:
            setattr(self, name, fields[name])

    def pack(self, mav: Any, force_mavlink1: bool = False) -> Any:
        """One packet, in pymavlink's form."""
        payload = self.unpacker.pack(*(getattr(self, name) for name in self.wire))
        return self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1)


class CurrentMode(_Message):
    """MAVLink message CURRENT_MODE: the mode being flown, as MAVLink's standard mode and as PX4's, and the intended mode."""

    id = 436
    msgname = "CURRENT_MODE"
    wire = ("custom_mode", "intended_custom_mode", "standard_mode")
    crc_extra = 193
    unpacker = struct.Struct("<IIB")


class Event(_Message):
    """MAVLink message EVENT: an event by its number in PX4's list.

    ``log_levels``: internal level in the upper half, external level in the lower half.
    """

    id = 410
    msgname = "EVENT"
    wire = (
        "event_id",
        "event_time_boot_ms",
        "sequence",
        "destination_component",
        "destination_system",
        "log_levels",
        "arguments",
    )
    crc_extra = 160
    unpacker = struct.Struct(f"<IIHBBB{ARGUMENTS}s")


class CurrentEventSequence(_Message):
    """MAVLink message CURRENT_EVENT_SEQUENCE: number of the latest event, so that a lost event is noticed.

    Flag 1: the number has been reset.
    """

    id = 411
    msgname = "CURRENT_EVENT_SEQUENCE"
    wire = ("sequence", "flags")
    crc_extra = 106
    unpacker = struct.Struct("<HB")


class AvailableModes(_Message):
    """MAVLink message AVAILABLE_MODES: one of the vehicle's flight modes. ``mode_index`` counts from 1.

    ``mode_name``: name of a mode outside MAVLink's own.
    """

    id = 435
    msgname = "AVAILABLE_MODES"
    wire = ("custom_mode", "properties", "number_modes", "mode_index", "standard_mode", "mode_name")
    crc_extra = 134
    unpacker = struct.Struct("<IIBBB35s")


class ProtocolVersion(_Message):
    """MAVLink message PROTOCOL_VERSION: versions of MAVLink times 100."""

    id = 300
    msgname = "PROTOCOL_VERSION"
    wire = ("version", "min_version", "max_version", "spec_version_hash", "library_version_hash")
    crc_extra = 217
    unpacker = struct.Struct("<HHH8s8s")


KINDS: dict[int, type[_Message]] = {
    kind.id: kind for kind in (CurrentMode, Event, CurrentEventSequence, AvailableModes, ProtocolVersion)
}


def decode(packet: bytes) -> _Message | None:
    """Decode a message of this module from a MAVLink 2 packet; None for any other kind of message.

    Raises:
        ValueError: the checksum is wrong.
    """
    kind = KINDS.get(int.from_bytes(packet[7:_HEADER], "little"))
    if kind is None:
        return None
    end = _HEADER + packet[1]
    checksum = mavlink.x25crc(packet[1:end])
    checksum.accumulate(bytes([kind.crc_extra]))
    if checksum.crc != int.from_bytes(packet[end : end + _CHECKSUM], "little"):
        raise ValueError(f"{kind.msgname}: wrong checksum")
    payload = packet[_HEADER:end].ljust(kind.unpacker.size, b"\0")  # MAVLink 2 omits zeros at the end
    return kind(**dict(zip(kind.wire, kind.unpacker.unpack(payload), strict=True)))
