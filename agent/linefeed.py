"""A TCP feed of lines on the vehicle network: taken up, read, and taken up anew for as long as it is wanted."""

from __future__ import annotations

import asyncio
import os
from collections import Counter
from collections.abc import AsyncIterator

from agent.errors import ConfigError

BACKOFF_S = (0.2, 2.0)  # before the first and the later attempts to connect, doubled each time
SILENCE_S = 3.0  # whoever has nothing to say sends an empty line each second
LONGEST_BYTES = 8192
_READ_BYTES = 1 << 16


class LineFeed:
    """The lines that come from ``address`` ("host:port"). ``counters``: connections, lines_too_long."""

    def __init__(self, what: str, key: str, address: str) -> None:
        """``what`` is at the other end, in words; ``key`` of the address in the drone file. Raises ConfigError: no address."""
        host, _, port = address.rpartition(":")
        if not host or not port.isdigit() or not 0 < int(port) < 65536:
            raise ConfigError(f'{key} = {address!r}: expected "host:port"')
        self._what = f"{what} at {address}"
        self._host, self._port = host.strip("[]"), int(port)
        self._closed = asyncio.Event()
        self._link: asyncio.WriteTransport | None = None
        self.problem: str | None = f"no link to {self._what} yet"
        self.counters: Counter[str] = Counter()

    async def lines(self) -> AsyncIterator[list[bytes]]:
        """What has come, line by line without the ends, empty ones left out; until ``close``."""
        pause_s = BACKOFF_S[0]
        while not self._closed.is_set():
            try:
                async with asyncio.timeout(SILENCE_S):
                    reader, writer = await asyncio.open_connection(self._host, self._port)
            except OSError as error:  # a TimeoutError is one too
                self.problem = f"no link to {self._what}: {_reason(error)}"
            else:
                self.counters["connections"] += 1
                self._link = writer.transport
                try:
                    async for lines in self._read(reader):
                        pause_s = BACKOFF_S[0]
                        yield lines
                finally:
                    self._link.abort()  # nothing is sent on this link, so there is nothing to wait for
            await self._wait(pause_s)
            pause_s = min(2.0 * pause_s, BACKOFF_S[1])

    async def _read(self, reader: asyncio.StreamReader) -> AsyncIterator[list[bytes]]:
        """The lines of one connection; ends, and says why in ``problem``, where it ends."""
        rest = b""
        while not self._closed.is_set():
            try:
                async with asyncio.timeout(SILENCE_S):
                    data = await reader.read(_READ_BYTES)
            except TimeoutError:
                self.problem = f"no data from {self._what} for {SILENCE_S:g} s"
                return
            except OSError as error:
                self.problem = f"lost the link to {self._what}: {_reason(error)}"
                return
            if not data:
                self.problem = f"lost the link to {self._what}: it was closed"
                return
            self.problem = None
            *lines, rest = (rest + data).split(b"\n")
            if len(rest) > LONGEST_BYTES:
                self.counters["lines_too_long"] += 1
                self.problem = f"{self._what} sends what is no feed: a line of more than {LONGEST_BYTES} bytes"
                return
            full = [line for line in lines if line.strip()]
            if full:
                yield full

    async def _wait(self, pause_s: float) -> None:
        """Sleep, but not beyond ``close``."""
        try:
            async with asyncio.timeout(pause_s):
                await self._closed.wait()
        except TimeoutError:
            pass

    async def close(self) -> None:
        """Let go of the link; ``lines`` ends."""
        self._closed.set()
        if self._link is not None:
            self._link.abort()


def _reason(error: OSError) -> str:
    if isinstance(error, TimeoutError):
        return "it does not answer"
    return os.strerror(error.errno).lower() if error.errno is not None and error.errno > 0 else str(error)
