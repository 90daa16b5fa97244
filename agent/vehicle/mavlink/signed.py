"""The first message of an autopilot on a link, checked before MAVSDK has it: its sender, and its signature (MAVLink 2 message
signing, https://mavlink.io/en/guide/message_signing.html).

A PX4 with a key signs its messages, and ignores unsigned ones, on every link. MAVSDK takes signed messages without a word, and
signs none: such a vehicle is seen, and obeys nothing. And packets that arrive before the kernel filters by sender, MAVSDK takes
from any sender.
"""

from __future__ import annotations

from typing import NamedTuple

from radron.agent.vehicle.mavlink.header import AUTOPILOT, FIRST_BYTES, header_at
from radron.agent.vehicle.mavlink.overhearing import overhear
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

FIRST_S = 1.2  # an autopilot sends a heartbeat each second, and mostly much else
SIGNED = CodedText(
    Code.AUTOPILOT_SIGNED,
    "the autopilot signs its MAVLink messages and ignores ours, as MAVSDK signs none: "
    "remove mavlink/mavlink-signing-key.bin from its SD card",
)


class First(NamedTuple):
    """The first message of an autopilot on a link: whether it is signed, and its sender.

    ``system``: MAVLink system id of the sender; ``sender``: its IP address, on a network.
    """

    is_signed: bool
    system: int
    sender: str | None = None


async def first_message(address: str, system_id: int | None, source: str | None, wait_s: float = FIRST_S) -> First | None:
    """Wait for the first message of an autopilot on this link, and return its sender and whether it is signed.

    Return None if no message came, or if the link is of another kind.

    Args:
        address, source, wait_s: see ``overhear``.
        system_id: MAVLink system id of the vehicle; None: any.

    Raises:
        VehicleError: ``source`` is no IPv4 address.
    """

    def judge(data: bytes, sender: str | None) -> First | None:
        first = first_of(data, system_id)
        return None if first is None else first._replace(sender=sender)

    return await overhear(address, judge, source, wait_s)


def first_of(data: bytes, system_id: int | None = None) -> First | None:
    """Return the first whole message of an autopilot in these bytes; None if there is none.

    Bytes count as a message if another message begins where they end, or nothing follows: checksums differ by message, and are
    left to MAVSDK. system_id: MAVLink system id of the vehicle; None: any.
    """
    for place in range(len(data)):
        header = header_at(data, place)
        if header is None or header.end > len(data) or (header.end < len(data) and data[header.end] not in FIRST_BYTES):
            continue
        system, component = header.sender
        if component == AUTOPILOT and system_id in (None, system):
            return First(header.is_signed, system)
    return None
