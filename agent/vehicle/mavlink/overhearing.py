"""Bytes that arrive on an autopilot's link, read without sending any, before MAVSDK has the link."""

from __future__ import annotations

import asyncio
import os
import re
import socket
import termios
import tty
from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

from radron.agent.vehicle.mavlink.exposure import take_only_from

_UDP = re.compile(r"(?:udp|udpin)://(?P<host>[^:/]*):(?P<port>\d+)$")
_SERIAL = re.compile(r"serial(?:_flowcontrol)?://(?P<device>[^:]+):(?P<baud>\d+)$")
_MOST_BYTES = 65_536

_T = TypeVar("_T")
Judge = Callable[[bytes, str | None], _T | None]  # of bytes, and the IP address of their sender, on a network


async def overhear(address: str, judge: Judge[_T], source: str | None, wait_s: float) -> _T | None:
    """Read the bytes that arrive on an autopilot's link until ``judge`` returns a result, and return this result.

    Return None if there is no result in time, or if the link is of another kind.

    Args:
        address: as for MAVSDK. The port or device must be free, and is free again afterwards.
        judge: called with each datagram, or with all bytes from a serial line so far (the last 64 kB); returns None to read on.
        source: IP address whose packets are judged; None: all.
        wait_s: maximum wait.

    Raises:
        VehicleError: ``source`` is no IPv4 address.
    """
    looking = _in_datagrams if listens(address) else _in_stream if _SERIAL.match(address) else None
    if looking is None:
        return None
    with suppress(TimeoutError, OSError, OverflowError, termios.error):  # MAVSDK reports the problem of the link
        async with asyncio.timeout(wait_s):
            return await looking(address, judge, source)
    return None


def listens(address: str) -> bool:
    """Whether this link receives UDP packets at a port of this computer, so that packets of any sender can arrive and be read
    here.
    """
    return _UDP.match(address) is not None


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
