"""A TCP feed of lines for tests: a client gets the lines sent after it has connected."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from radron.sim.live.feed import ByteServer


class LineServer(ByteServer):
    """``address`` as a drone file has it; it stays when the server is stopped and started again."""

    def __init__(self) -> None:
        super().__init__()
        self._port = 0

    @property
    def address(self) -> str:
        return f"127.0.0.1:{self._port}"

    async def start(self) -> None:
        self._port = await super().start("127.0.0.1", self._port)

    def send(self, data: bytes) -> None:
        self.send_bytes(data)


@asynccontextmanager
async def line_server() -> AsyncIterator[LineServer]:
    server = LineServer()
    await server.start()
    try:
        yield server
    finally:
        await server.close()
