"""Notifications to the service manager by the sd_notify protocol; without a service manager nothing happens.

Written by hand: the protocol is one datagram, and a library for it would be loaded into the watchdog, which must stay small.
"""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Mapping
from contextlib import suppress

VARIABLES = ("NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID")


class Notifier:
    """Sends state lines such as ``READY=1`` to the service manager, through the socket that ``NOTIFY_SOCKET`` names
    (sd_notify(3)).

    Nothing is raised and nothing blocks without a listening service manager.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        address = environment.get("NOTIFY_SOCKET", "")
        self._socket: socket.socket | None = None
        if address.startswith(("/", "@")):
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
            with suppress(OSError):
                self._socket.connect("\0" + address[1:] if address[0] == "@" else address)
        wanted = environment.get("WATCHDOG_USEC", "")
        # Three times per watchdog interval, so that a late notification does no harm.
        self._period_s = int(wanted) * 1e-6 / 3.0 if wanted.isdigit() else float("inf")
        self._due_s = 0.0

    def tell(self, *lines: str) -> None:
        """Send state lines to the service manager in one message."""
        if self._socket is not None:
            with suppress(OSError):
                self._socket.send("\n".join(lines).encode())

    def alive(self) -> None:
        """Report that this process is alive (``WATCHDOG=1``), as often as the service manager requires."""
        now_s = time.monotonic()
        if now_s >= self._due_s and self._period_s != float("inf"):
            self._due_s = now_s + self._period_s
            self.tell("WATCHDOG=1")

    def close(self) -> None:
        """Close the socket to the service manager."""
        if self._socket is not None:
            self._socket.close()
