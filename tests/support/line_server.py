"""A TCP feed of lines for tests: whoever connects gets what is sent from then on."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager


class LineServer:
    """``address`` as a drone file has it."""

    def __init__(self) -> None:
        self._writers: list[asyncio.StreamWriter] = []
        self._server: asyncio.Server | None = None
        self.port = 0

    @property
    def address(self) -> str:
        return f"127.0.0.1:{self.port}"

    @property
    def clients(self) -> int:
        return len(self._writers)

    async def start(self) -> None:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", self.port)
        self.port = self._server.sockets[0].getsockname()[1]

    async def stop(self) -> None:
        assert self._server is not None
        self._server.close()
        for writer in self._writers:
            writer.transport.abort()
        await self._server.wait_closed()
        while self._writers:  # a handler that the loop's end cuts short would leave a traceback
            await asyncio.sleep(0.0)

    def send(self, data: bytes) -> None:
        for writer in self._writers:
            writer.write(data)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.append(writer)
        try:
            await reader.read()
        except OSError:
            pass
        finally:
            self._writers.remove(writer)
            writer.transport.abort()


@asynccontextmanager
async def line_server() -> AsyncIterator[LineServer]:
    server = LineServer()
    await server.start()
    try:
        yield server
    finally:
        await server.stop()
