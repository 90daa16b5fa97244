"""A link to a computer that can be lost: as with a radio out of reach, no side is notified, and data under way arrive later."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress


class Cable:
    """Passes TCP connections on to a port of 127.0.0.1 while it is plugged in. ``port``: where it begins."""

    def __init__(self, port: int) -> None:
        self._target = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._plugged = threading.Event()
        self._plugged.set()
        self._left: int | None = None  # bytes in both directions until it is pulled
        self._lock = threading.Lock()
        threading.Thread(target=self._accept, daemon=True).start()

    def pull_after(self, count: int) -> None:
        """Be pulled when this many bytes more have passed."""
        with self._lock:
            self._left = count

    def plug(self) -> None:
        """Be whole again."""
        with self._lock:
            self._left = None
        self._plugged.set()

    def close(self) -> None:
        """No more connections."""
        self._listener.close()
        self.plug()

    def _accept(self) -> None:
        with suppress(OSError):  # closed
            while True:
                near, _ = self._listener.accept()
                far = socket.create_connection(("127.0.0.1", self._target))
                for one, other in ((near, far), (far, near)):
                    threading.Thread(target=self._pass_on, args=(one, other), daemon=True).start()

    def _pass_on(self, one: socket.socket, other: socket.socket) -> None:
        with suppress(OSError):
            while data := one.recv(65536):
                self._count(len(data))
                self._plugged.wait()
                other.sendall(data)
        with suppress(OSError):
            other.shutdown(socket.SHUT_WR)

    def _count(self, passed: int) -> None:
        with self._lock:
            if self._left is not None:
                self._left -= passed
                if self._left <= 0:
                    self._plugged.clear()


@contextmanager
def cable_to(port: int) -> Iterator[Cable]:
    """A cable to a port of 127.0.0.1."""
    cable = Cable(port)
    try:
        yield cable
    finally:
        cable.close()
