"""A bound on the open HTTP connections: a client that opens many cannot exhaust the station's file descriptors.

The sockets of pages and Foxglove are not counted here: their connections leave HTTP with the token.
"""

from __future__ import annotations

import asyncio
import time
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

MAX_CONNECTIONS = 64  # a browser opens six at once


class BoundedHttp(H11Protocol):
    """HTTP connection of the web server (uvicorn) with a limit on the number of open connections.

    Above the limit, a new connection ends the connection that has been silent for the longest time.
    """

    heard_s = 0.0  # time of the last data (monotonic clock)

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # as uvicorn narrows it
        """Accept a new connection; above ``MAX_CONNECTIONS``, abort the connection that has been silent for the longest time."""
        self.heard_s = time.monotonic()
        super().connection_made(transport)
        others = [one for one in self.connections if isinstance(one, BoundedHttp) and one is not self]
        if len(others) >= MAX_CONNECTIONS:
            silent = min(others, key=lambda one: one.heard_s)
            self.connections.discard(silent)
            silent.transport.abort()

    def data_received(self, data: bytes) -> Any:
        """Process received data, and record the time."""
        self.heard_s = time.monotonic()
        return super().data_received(data)
