"""A drone's simulated camera as a TCP feed on the vehicle network."""

from __future__ import annotations

import asyncio
from collections import Counter

from agent.detector.readout import Readout
from agent.detector.wire import pack

BACKLOG_BYTES = 1 << 20  # of a client that does not keep up; at 12 bytes a hit, several seconds of a dense feed


class FeedServer:
    """Serves one camera's readouts to whoever connects, from the next readout on.

    A client that does not keep up loses readouts instead of growing the queue. ``counters``: sent, dropped, clients.
    """

    def __init__(self) -> None:
        self._server: asyncio.Server | None = None
        self._clients: set[asyncio.StreamWriter] = set()
        self.counters: Counter[str] = Counter()

    async def start(self, host: str, port: int = 0) -> int:
        """Listen; returns the port (0: a free one is taken). Raises OSError where it is in use."""
        self._server = await asyncio.start_server(self._serve, host, port)
        found: int = self._server.sockets[0].getsockname()[1]
        return found

    @property
    def clients(self) -> int:
        """How many are connected."""
        return len(self._clients)

    def send(self, readout: Readout) -> None:
        """Hand a readout to every client; never waits."""
        if not self._clients:
            return
        frame = pack(readout)
        for writer in self._clients:
            if writer.transport.get_write_buffer_size() + len(frame) > max(BACKLOG_BYTES, len(frame)):
                self.counters["dropped"] += 1
            else:
                writer.write(frame)
                self.counters["sent"] += 1

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._clients.add(writer)
        self.counters["clients"] += 1
        try:
            while await reader.read(4096):  # a client has nothing to say; this waits for its end
                pass
        except OSError:
            pass
        finally:
            self._clients.discard(writer)
            writer.transport.abort()

    async def close(self) -> None:
        """Stop listening and drop all clients."""
        if self._server is None:
            return
        self._server.close()
        for writer in self._clients:
            writer.transport.abort()
        await self._server.wait_closed()
        while self._clients:  # a handler that the loop's end cuts short would leave a traceback
            await asyncio.sleep(0.0)
