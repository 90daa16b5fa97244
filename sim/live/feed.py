"""TCP servers from which an agent reads its drone's simulated sensors."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Sequence

import msgspec

from radron.agent.detector.readout import Readout
from radron.agent.detector.wire import pack

BACKLOG_BYTES = 1 << 20  # of a slow client; at 12 bytes a hit, several seconds of a dense feed


class ByteServer:
    """Sends data frames of a sensor to all connected clients, each from the next frame on.

    A slow client loses frames instead of growing the queue. ``counters``: sent, dropped, clients.
    """

    def __init__(self) -> None:
        self._server: asyncio.Server | None = None
        self._clients: set[asyncio.StreamWriter] = set()
        self.counters: Counter[str] = Counter()

    async def start(self, host: str, port: int = 0) -> int:
        """Listen for clients, and return the port. ``port``: 0: a free one is chosen. Raises OSError if it is in use."""
        self._server = await asyncio.start_server(self._serve, host, port)
        found: int = self._server.sockets[0].getsockname()[1]
        return found

    @property
    def clients(self) -> int:
        """Number of connected clients."""
        return len(self._clients)

    def send_bytes(self, frame: bytes) -> None:
        """Send a frame to every client; the call never waits."""
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
            while await reader.read(4096):  # clients send nothing; this waits for their end
                pass
        except OSError:
            pass
        finally:
            self._clients.discard(writer)
            writer.transport.abort()

    async def close(self) -> None:
        """Stop listening and disconnect all clients."""
        if self._server is None:
            return
        self._server.close()
        for writer in self._clients:
            writer.transport.abort()
        await self._server.wait_closed()
        while self._clients:  # a handler cancelled by the end of the loop would leave a traceback
            await asyncio.sleep(0.0)


class FeedServer(ByteServer):
    """Sends the readouts of one camera to its agent."""

    def send(self, readout: Readout) -> None:
        """Send a readout to every client; the call never waits."""
        if self.clients:
            self.send_bytes(pack(readout))


class LineServer(ByteServer):
    """Sends the data of one sensor to its agent, a JSON object per line."""

    def send(self, said: Sequence[object]) -> None:
        """Send some objects as lines; without any, an empty line as a keep-alive."""
        if self.clients:
            self.send_bytes(b"".join(msgspec.json.encode(line) + b"\n" for line in said) or b"\n")
