"""The serial line of an autopilot and a virtual computer: the emulated vehicle has its end by UDP, QEMU's USB adapter by TCP."""

from __future__ import annotations

import select
import socket
import threading
from contextlib import suppress

BUFFER_BYTES = 4096


class SerialLine:
    """Passes on what both ends say. ``vehicle_port``: where the vehicle sends to; ``port``: where the adapter connects to, also
    again, after the computer was switched off. Bytes that the computer does not take in time are lost, as on a line.
    """

    def __init__(self) -> None:
        self._vehicle = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._vehicle.bind(("127.0.0.1", 0))
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.vehicle_port, self.port = (int(end.getsockname()[1]) for end in (self._vehicle, self._listener))
        self._adapter: socket.socket | None = None
        self._sender: tuple[str, int] | None = None  # the vehicle's own port
        for work in (self._to_computer, self._to_vehicle):
            threading.Thread(target=work, daemon=True).start()

    def close(self) -> None:
        """Unplug it."""
        for end in (self._listener, self._vehicle, self._adapter):
            if end is not None:
                with suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)  # wakes the thread that waits at it
                end.close()

    def _to_computer(self) -> None:
        with suppress(OSError):  # closed
            while data := self._said_by_vehicle():
                adapter = self._adapter
                with suppress(OSError, ValueError):  # switched off
                    if adapter is not None and select.select([], [adapter], [], 0.0)[1]:
                        adapter.sendall(data)

    def _said_by_vehicle(self) -> bytes:
        data, self._sender = self._vehicle.recvfrom(65536)
        return data

    def _to_vehicle(self) -> None:
        with suppress(OSError):  # closed
            while True:
                self._adapter, _ = self._listener.accept()
                self._adapter.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
                with suppress(ConnectionResetError):
                    while data := self._adapter.recv(4096):
                        if self._sender is not None:
                            self._vehicle.sendto(data, self._sender)
