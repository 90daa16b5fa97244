"""A stretch of network between a browser and a station that can stall: data sent meanwhile arrive when the stretch goes on."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_CHUNK = 65_536


class Gate:
    """``address``: of the page through it. ``stall`` and ``go``: both directions of all its connections."""

    def __init__(self, address: str, port: int) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self._open = threading.Event()
        self._open.set()
        own = self._server.getsockname()[1]
        # The station answers to its own name and port only: the browser's headers get them, as if both were on one computer.
        self._names = f"localhost:{own}".encode(), f"localhost:{port}".encode()
        self._port = port
        self._sockets = [self._server]
        self.address = f"http://localhost:{own}/?{address.partition('?')[2]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def stall(self) -> None:
        self._open.clear()

    def go(self) -> None:
        self._open.set()

    def close(self) -> None:
        self._open.set()
        for one in self._sockets:
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._server.accept()
                far = socket.create_connection(("127.0.0.1", self._port))
                self._sockets += [near, far]
                threading.Thread(target=self._pass, args=(near, far, self._names), daemon=True).start()
                threading.Thread(target=self._pass, args=(far, near, None), daemon=True).start()

    def _pass(self, source: socket.socket, target: socket.socket, names: tuple[bytes, bytes] | None) -> None:
        with suppress(OSError):
            while data := source.recv(_CHUNK):
                self._open.wait()
                target.sendall(data if names is None else data.replace(*names))
        with suppress(OSError):
            target.shutdown(socket.SHUT_WR)


@contextmanager
def gate(address: str, port: int) -> Iterator[Gate]:
    """A gate before a page that is served at an address and a port, as long as the block lasts."""
    found = Gate(address, port)
    try:
        yield found
    finally:
        found.close()
