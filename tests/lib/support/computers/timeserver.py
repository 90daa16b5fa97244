"""A time server (RFC 5905) with the time of the own computer on a port that needs no root."""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Thread

_FROM_1900_S = 2_208_988_800
_FORMAT = "!BBbbII4sQQQQ"
_VERSION_4_SERVER, _STRATUM, _POLL, _PRECISION = 0x24, 1, 2, -20


@contextmanager
def time_server() -> Iterator[int]:
    """While it is entered, it answers on this port of 127.0.0.1."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", 0))
        thread = Thread(target=_serve, args=(server,), daemon=True)
        thread.start()
        yield int(server.getsockname()[1])
        with suppress(OSError):  # not connected; it wakes the thread all the same
            server.shutdown(socket.SHUT_RDWR)
        thread.join()


def _serve(server: socket.socket) -> None:
    while True:
        request, sender = server.recvfrom(1024)
        if len(request) < struct.calcsize(_FORMAT):
            return
        now, asked = _now(), struct.unpack_from("!Q", request, 40)[0]
        head = (_VERSION_4_SERVER, _STRATUM, _POLL, _PRECISION, 0, 0, b"TEST")
        server.sendto(struct.pack(_FORMAT, *head, now, asked, now, _now()), sender)


def _now() -> int:
    return ((time.time_ns() + _FROM_1900_S * 1_000_000_000) << 32) // 1_000_000_000
