"""A TCP relay between two agents that can be impaired like a radio link, each direction on its own.

Neither end is notified: a cut link stays open and silent, as TCP's links do, and a connection dialled meanwhile is not
answered. Data under way arrive after the cut, as TCP would repeat them.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from random import Random

from radron.sim.live.relays.linkstate import PASSING, LinkState

READ_BYTES = 65_536
MAX_PIECES = 64  # under way in one direction of a connection; then the sender is blocked
_Address = tuple[str, int]


class Direction:
    """Impairs one direction of a TCP relay, for all its connections."""

    def __init__(self, random: Random) -> None:
        self._random = random
        self._state = PASSING
        self._free_s = 0.0  # end of the present transmission, with a limited rate
        self.open = asyncio.Event()  # not cut
        self.flows = asyncio.Event()  # neither cut nor frozen
        self.state = PASSING

    @property
    def state(self) -> LinkState:
        """The present impairment; its probabilities concern packets, and have no effect here."""
        return self._state

    @state.setter
    def state(self, state: LinkState) -> None:
        self._state = state
        for event, passes in ((self.open, not state.cut), (self.flows, not state.cut and not state.frozen)):
            if passes:
                event.set()
            else:
                event.clear()

    def due_s(self, size: int, now_s: float) -> float:
        """Return the arrival time of a piece of data that is accepted now."""
        state = self._state
        if state.rate_bytes_ps > 0.0:
            self._free_s = max(self._free_s, now_s) + size / state.rate_bytes_ps
            now_s = self._free_s
        return now_s + state.delay_s + state.jitter_s * self._random.random()

    async def carry(self, early: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Pass a stream on until its end. ``early``: bytes that were read from it before."""
        pieces: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(MAX_PIECES)
        taking = asyncio.create_task(self._take(early, reader, pieces))
        try:
            await self._hand_on(pieces, writer)
        finally:
            taking.cancel()

    async def _take(self, early: bytes, reader: asyncio.StreamReader, pieces: asyncio.Queue[tuple[float, bytes]]) -> None:
        now_s = asyncio.get_running_loop().time
        data, last_s = early or b"", 0.0
        try:
            while True:
                if data:
                    last_s = max(last_s, self.due_s(len(data), now_s()))  # a stream keeps its order
                    await pieces.put((last_s, data))
                await self.open.wait()
                data = await reader.read(READ_BYTES)
                if not data:
                    break
        except OSError:
            pass
        await pieces.put((last_s, b""))

    async def _hand_on(self, pieces: asyncio.Queue[tuple[float, bytes]], writer: asyncio.StreamWriter) -> None:
        now_s = asyncio.get_running_loop().time
        while True:
            due_s, data = await pieces.get()
            wait_s = due_s - now_s()
            if wait_s > 0.0:
                await asyncio.sleep(wait_s)
            await self.flows.wait()
            if not data:
                writer.write_eof()
                return
            writer.write(data)
            await writer.drain()


class Relay:
    """TCP relay to one address, which can be impaired like a radio link.

    ``there``: direction from the dialling end to the dialled end; ``back``: the reverse direction.
    """

    def __init__(self, target: _Address, random: Random) -> None:
        self.there, self.back = Direction(random), Direction(random)
        self._target = target
        self._server: asyncio.Server | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    async def start(self, host: str, port: int = 0) -> int:
        """Listen, and return the port (0: a free one is chosen). Raises OSError if it is in use."""
        self._server = await asyncio.start_server(self._serve, host, port)
        found: int = self._server.sockets[0].getsockname()[1]
        return found

    async def close(self) -> None:
        """Stop listening, and close all connections."""
        if self._server is not None:
            self._server.close()
        for task in set(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        try:
            early = await self._until_open(reader)
            if early is not None:
                await self._connect(early, reader, writer)
        except (OSError, asyncio.CancelledError):
            pass  # an end is gone, or the relay is being closed
        finally:
            writer.transport.abort()
            self._tasks.discard(task)

    async def _until_open(self, reader: asyncio.StreamReader) -> bytes | None:
        """Wait until both directions pass; return the data sent meanwhile, or None if the caller has given up."""
        early = b""
        opening = asyncio.create_task(self._opens())
        await asyncio.sleep(0.0)
        try:
            while not opening.done():
                reading = asyncio.create_task(reader.read(READ_BYTES))
                await asyncio.wait((opening, reading), return_when=asyncio.FIRST_COMPLETED)
                if not reading.done():
                    reading.cancel()
                    with suppress(asyncio.CancelledError):
                        await reading
                    return early
                if not reading.result():
                    return None
                early += reading.result()
            return early
        finally:
            opening.cancel()

    async def _opens(self) -> None:
        while not (self.there.open.is_set() and self.back.open.is_set()):
            await self.there.open.wait()
            await self.back.open.wait()

    async def _connect(self, early: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there_reader, there_writer = await asyncio.open_connection(*self._target)
        flows = [
            asyncio.create_task(self.there.carry(early, reader, there_writer)),
            asyncio.create_task(self.back.carry(b"", there_reader, writer)),
        ]
        try:
            await asyncio.gather(*flows)
        finally:
            for flow in flows:
                flow.cancel()
            there_writer.transport.abort()
