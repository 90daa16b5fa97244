"""Exposure of the autopilot to other senders of commands: it obeys every sender that reaches its MAVLink port."""

from __future__ import annotations

import ctypes
import ipaddress
import os
import re
import socket
import struct
from contextlib import suppress

from radron.agent.errors import VehicleError
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

_NETWORK = re.compile(r"(?P<kind>udp|udpin|udpout|tcp|tcpin|tcpout)://(?P<host>\[[^\]]*\]|[^:/]*)(?::(?P<port>\d+))?")
_SO_ATTACH_FILTER = 26
_SENDER = -0x100000 + 12  # Linux: the network header begins there; the sender's address is its bytes 12 to 15
_LOAD, _IF_EQUAL, _RETURN = 0x20, 0x15, 0x06  # of the kernel's packet filter: BPF_LD, BPF_JMP | BPF_JEQ, BPF_RET


def exposure(address: str, source: str | None = None, first: str | None = None) -> CodedText | None:
    """Return the warning to the operator if other computers can send commands to the autopilot over this link; else None.

    Loopbacks and serial lines are safe.

    address: of the link, as for MAVSDK. source: address whose packets are accepted, as the drone file gives it. first: address of
    the vehicle that was heard first, whose packets are accepted without ``source``.
    """
    match = _NETWORK.match(address)
    if match is None:
        return None
    host = match["host"].strip("[]")
    with suppress(ValueError):
        if host == "localhost" or ipaddress.ip_address(host).is_loopback:
            return None
    taken = "packets are taken from everybody (vehicle.source is not set)"
    if source is not None:
        taken = f"packets only from {source}"
    elif first is not None:
        taken = f"packets only from {first}, whose vehicle was heard first (vehicle.source is not set)"
    text = f"MAVLink at {address} is neither loopback nor serial, {taken}: whoever is on this network can command the autopilot"
    return CodedText(Code.AUTOPILOT_PORT_OPEN, text)


def take_only_from(address: str, source: str) -> None:
    """Have the kernel drop packets from all addresses but ``source`` at the UDP socket of the link.

    The kernel does this without a relay, which could delay packets.

    Raises:
        VehicleError: not a UDP link, not an IPv4 address, or no such socket in this process.
    """
    match = _NETWORK.match(address)
    if match is None or match["kind"] not in ("udp", "udpin") or match["port"] is None:
        raise VehicleError(f"vehicle.source: {source}: {address} is not a UDP link; remove vehicle.source, or use udpin://...")
    try:
        allowed = int(ipaddress.IPv4Address(source))
    except ValueError:
        raise VehicleError(f"vehicle.source: {source!r} is not an IPv4 address, such as 10.41.10.2") from None
    program = b"".join(
        struct.pack("HBBI", *instruction)
        for instruction in (
            (_LOAD, 0, 0, _SENDER & 0xFFFFFFFF),
            (_IF_EQUAL, 0, 1, allowed),
            (_RETURN, 0, 0, 0xFFFFFFFF),
            (_RETURN, 0, 0, 0),
        )
    )
    if not _attach(int(match["port"]), program):
        raise VehicleError(f"vehicle.source: {source}: the socket of {address} is not found; remove vehicle.source")


def _attach(port: int, program: bytes) -> bool:
    """Attach a filter to all UDP sockets of this process at a port; whether there was one."""
    code = ctypes.create_string_buffer(program)
    found = False
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):  # not a socket, or closed meanwhile
            one = socket.socket(fileno=int(name))
            try:
                if one.type == socket.SOCK_DGRAM and one.family == socket.AF_INET and one.getsockname()[1] == port:
                    one.setsockopt(
                        socket.SOL_SOCKET, _SO_ATTACH_FILTER, struct.pack("HP", len(program) // 8, ctypes.addressof(code))
                    )
                    found = True
            finally:
                one.detach()
    return found
