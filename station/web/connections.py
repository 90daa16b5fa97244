"""A bound on the connections that have asked for nothing yet: whoever opens many cannot take the file descriptors of the station.

Pages and Foxglove have sockets, which are not counted here: their connections leave HTTP with the token.
"""

from __future__ import annotations

import asyncio
import time
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

MAX_CONNECTIONS = 64  # a browser opens six at once


class BoundedHttp(H11Protocol):
    """HTTP of uvicorn, of whose connections the one that has been silent for the longest gives way to a new one."""

    heard_s = 0.0  # when it was last heard (monotonic clock)

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # as uvicorn narrows it
        """Take a connection; too many: end another one."""
        self.heard_s = time.monotonic()
        super().connection_made(transport)
        others = [one for one in self.connections if isinstance(one, BoundedHttp) and one is not self]
        if len(others) >= MAX_CONNECTIONS:
            silent = min(others, key=lambda one: one.heard_s)
            self.connections.discard(silent)
            silent.transport.abort()

    def data_received(self, data: bytes) -> Any:
        """Take what it says."""
        self.heard_s = time.monotonic()
        return super().data_received(data)
