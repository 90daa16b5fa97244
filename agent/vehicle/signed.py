"""The first message of an autopilot on a link, looked at before MAVSDK has it: whose it is, and whether it is signed
(MAVLink 2 message signing, https://mavlink.io/en/guide/message_signing.html).

A PX4 that has a key signs what it sends, and ignores what is not signed, on every link. MAVSDK takes signed messages without a
word, and signs none: such a vehicle is seen, and obeys nothing. And what arrives before the kernel can be told whose packets
count, MAVSDK takes from everybody.
"""

from __future__ import annotations

import asyncio
import os
import re
import socket
import termios
import tty
from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple, TypeVar

from agent.vehicle.exposure import take_only_from

FIRST_S = 1.2  # an autopilot sends a heartbeat each second, and mostly much else
SIGNED = (
    "the autopilot signs its MAVLink messages and ignores ours, as MAVSDK signs none: "
    "remove mavlink/mavlink-signing-key.bin from its SD card"
)
_UDP = re.compile(r"(?:udp|udpin)://(?P<host>[^:/]*):(?P<port>\d+)$")
_SERIAL = re.compile(r"serial(?:_flowcontrol)?://(?P<device>[^:]+):(?P<baud>\d+)$")
_AUTOPILOT = 1  # component
_FIRST, _SECOND = 0xFE, 0xFD  # versions of MAVLink, by the first byte of a message
_FIRST_BYTES, _SECOND_BYTES, _SIGNATURE_BYTES = 8, 12, 13  # besides the payload
_IS_SIGNED = 0x01  # of the incompatibility flags
_MOST_BYTES = 65_536


class First(NamedTuple):
    """The first message of an autopilot. ``system``: its MAVLink system id; ``sender``: its IP address, on a network."""

    is_signed: bool
    system: int
    sender: str | None = None


_T = TypeVar("_T")
Judge = Callable[[bytes, str | None], _T | None]  # of bytes, and the IP address of their sender, on a network


async def first_message(address: str, system_id: int | None, source: str | None, wait_s: float = FIRST_S) -> First | None:
    """The first message of an autopilot on this link; None: none came, or the link is of another kind.

    Args:
        address: as for MAVSDK. The port or device must be free, and is free again afterwards.
        system_id: of the vehicle; None: any.
        source: IP address whose packets are looked at; None: all.
        wait_s: how long to look at most.

    Raises:
        VehicleError: ``source`` is no IPv4 address.
    """

    def judge(data: bytes, sender: str | None) -> First | None:
        first = first_of(data, system_id)
        return None if first is None else first._replace(sender=sender)

    return await overhear(address, judge, source, wait_s)


async def overhear(address: str, judge: Judge[_T], source: str | None, wait_s: float) -> _T | None:
    """What ``judge`` first makes of the bytes that arrive on this link, without sending any; None: nothing, or the link is of
    another kind. Other arguments and errors: see ``first_message``.
    """
    looking = _in_datagrams if listens(address) else _in_stream if _SERIAL.match(address) else None
    if looking is None:
        return None
    with suppress(TimeoutError, OSError, OverflowError, termios.error):  # MAVSDK says what is wrong with the link
        async with asyncio.timeout(wait_s):
            return await looking(address, judge, source)
    return None


def listens(address: str) -> bool:
    """Whether a link is one at whose port packets of everybody can arrive, and be looked at here."""
    return _UDP.match(address) is not None


def first_of(data: bytes, system_id: int | None = None) -> First | None:
    """The first whole message of an autopilot in these bytes; None: there is none.

    A message is one if another begins where it ends, or nothing follows: checksums differ by message, and are left to MAVSDK.
    """
    for place in range(len(data) - _FIRST_BYTES):
        length, flags = data[place + 1], data[place + 2]
        if data[place] == _SECOND:
            is_signed = bool(flags & _IS_SIGNED)
            end, sender = place + _SECOND_BYTES + length + _SIGNATURE_BYTES * is_signed, place + 5
        elif data[place] == _FIRST:
            end, sender, is_signed = place + _FIRST_BYTES + length, place + 3, False
        else:
            continue
        if end > len(data) or (end < len(data) and data[end] not in (_FIRST, _SECOND)):
            continue
        if data[sender + 1] == _AUTOPILOT and system_id in (None, data[sender]):
            return First(is_signed, data[sender])
    return None


async def _in_datagrams(address: str, judge: Judge[_T], source: str | None) -> _T:
    match = _UDP.match(address)
    assert match is not None
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.setblocking(False)
        link.bind((match["host"] or "0.0.0.0", int(match["port"])))
        if source is not None:
            take_only_from(address, source)
        while True:
            data, sender = await asyncio.get_running_loop().sock_recvfrom(link, _MOST_BYTES)
            found = judge(data, sender[0]) if source in (None, sender[0]) else None  # others' may have come before the filter
            if found is not None:
                return found


async def _in_stream(address: str, judge: Judge[_T], source: str | None) -> _T:
    match = _SERIAL.match(address)
    assert match is not None
    loop, heard = asyncio.get_running_loop(), bytearray()
    line = os.open(match["device"], os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        tty.setraw(line)
        settings = termios.tcgetattr(line)
        settings[4] = settings[5] = getattr(termios, f"B{match['baud']}", settings[5])
        termios.tcsetattr(line, termios.TCSANOW, settings)
        while (found := judge(bytes(heard), None)) is None:
            readable: asyncio.Future[None] = loop.create_future()
            loop.add_reader(line, _settle, readable)
            try:
                await readable
            finally:
                loop.remove_reader(line)
            heard += os.read(line, _MOST_BYTES)
            del heard[:-_MOST_BYTES]
        return found
    finally:
        os.close(line)


def _settle(future: asyncio.Future[None]) -> None:
    if not future.done():
        future.set_result(None)
