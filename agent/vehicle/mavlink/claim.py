"""Exclusive use of the UDP port of an autopilot's link; another process that holds it is named."""

from __future__ import annotations

import asyncio
import errno
import os
import re
import socket
import time
from pathlib import Path

from radron.agent.errors import VehicleError

PATIENCE_S = 10.0  # wait this long for a port in use: a process that has just ended may not have released it yet
MAX_PORT = 65535
_AGAIN_S = 0.5
_UDP = re.compile(r"(?:udp|udpin)://([^:/]*):(\d+)$")
_TABLES = (Path("/proc/net/udp"), Path("/proc/net/udp6"))
_PROCESSES = Path("/proc")


async def claim_port(address: str, patience_s: float = PATIENCE_S) -> None:
    """Check that no other process listens on the UDP port of an autopilot's link.

    MAVSDK would share the port, and each process would get half of the packets.

    Raises:
        VehicleError: the port is still in use after ``patience_s``, or cannot be used at all.
    """
    match = _UDP.match(address)
    if match is None:
        return
    host, port = match.group(1) or "0.0.0.0", int(match.group(2))
    if not 0 < port <= MAX_PORT:
        raise VehicleError(f"{address}: {port} is not a port; expected 1 .. {MAX_PORT}")
    deadline_s = time.monotonic() + patience_s
    while not _is_free(address, host, port):
        if time.monotonic() >= deadline_s:
            raise VehicleError(f"{address}: the port has been in use for {patience_s:g} s {_by_whom(port)}")
        await asyncio.sleep(_AGAIN_S)


def _is_free(address: str, host: str, port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((host, port))
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise VehicleError(f"{address}: cannot listen there: {error.strerror or error}") from None
            return False
    return True


def _by_whom(port: int) -> str:
    """The processes that hold the port, as far as this user may see them."""
    names = holders(port)
    if names:
        return f"by {', '.join(names)}: stop it, or give this agent another port"
    return f"(is another agent, or a ground station, running here? `ss -lunp sport = :{port}` as root shows it)"


def holders(port: int) -> list[str]:
    """Return name and id of each process with a UDP socket on this port, except processes of other users."""
    sockets = {f"socket:[{inode}]" for table in _TABLES for inode in _inodes(table, port)}
    found = []
    for process in sorted(_PROCESSES.glob("[0-9]*"), key=lambda path: int(path.name)):
        try:
            if not any(os.readlink(entry) in sockets for entry in (process / "fd").iterdir()):
                continue
            name = (process / "comm").read_text().strip()
        except OSError:  # another user's, or ended meanwhile
            continue
        found.append(f"{name} (process {process.name})")
    return found


def _inodes(table: Path, port: int) -> list[str]:
    """Inodes of the sockets bound to this port, from the kernel's table: column 2 is address:port, column 10 the inode."""
    try:
        lines = table.read_text().splitlines()[1:]
    except OSError:
        return []
    rows = [line.split() for line in lines]
    return [row[9] for row in rows if int(row[1].rsplit(":", 1)[1], 16) == port]
