"""A TCP feed on the vehicle network: connected, read, and reconnected until it is closed."""

from __future__ import annotations

import asyncio
import os
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterable, Iterator
from typing import Generic, TypeVar

from radron.agent.errors import ConfigError, RadronError

Item = TypeVar("Item")

BACKOFF_S = (0.2, 2.0)  # pause after the first attempt to connect, doubled each time up to the second
SILENCE_S = 3.0  # timeout of a silent link: without data, a sender sends an empty line or frame each second
LONGEST_BYTES = 8192  # in a line
_READ_BYTES = 1 << 18


class CorruptFeedError(RadronError):
    """The sender of a TCP feed sent bytes that do not belong to the feed's format."""


class Feed(Generic[Item]):
    """A TCP client that yields the decoded items of a sender at ``address`` ("host:port"), and reconnects after each fault.

    ``problem``: the present fault of the link, in words; None without one. ``counters``: number of connections.
    """

    def __init__(self, what: str, key: str, address: str, decoder: Callable[[], Callable[[bytes], Iterable[Item]]]) -> None:
        """Set up a client that is not connected yet.

        Args:
            what: the sender, in words.
            key: of the address in the drone file.
            address: of the sender.
            decoder: makes a decoder for each connection, from bytes, split anywhere, to items; it raises a RadronError for
                malformed bytes, and the link is reconnected.

        Raises:
            ConfigError: not an address.
        """
        host, _, port = address.rpartition(":")
        if not host or not port.isdigit() or not 0 < int(port) < 65536:
            raise ConfigError(f'{key} = {address!r}: expected "host:port"')
        self._what = f"{what} at {address}"
        self._host, self._port = host.strip("[]"), int(port)
        self._decoder = decoder
        self._closed = asyncio.Event()
        self._link: asyncio.WriteTransport | None = None
        self.problem: str | None = f"no link to {self._what} yet"
        self.counters: Counter[str] = Counter()

    async def items(self) -> AsyncIterator[Item]:
        """Yield the sender's decoded items as they arrive, across reconnections, until ``close`` is called."""
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
                    async for item in self._read(reader):
                        pause_s, self.problem = BACKOFF_S[0], None
                        yield item
                finally:
                    self._link.abort()  # nothing is sent on this link, so nothing can be lost
            await self._wait(pause_s)
            pause_s = min(2.0 * pause_s, BACKOFF_S[1])

    async def _read(self, reader: asyncio.StreamReader) -> AsyncIterator[Item]:
        """The items of one connection; at its end ``problem`` says why it ended."""
        decode = self._decoder()
        while not self._closed.is_set():
            try:
                for item in decode(await _received(reader)):
                    yield item
            except RadronError as error:
                self.problem = f"{self._what} sends malformed data: {error}"
                return
            except TimeoutError:
                self.problem = f"no data from {self._what} for {SILENCE_S:g} s"
                return
            except OSError as error:
                self.problem = f"lost the link to {self._what}: {_reason(error)}"
                return

    async def _wait(self, pause_s: float) -> None:
        """Sleep, at most until ``close``."""
        try:
            async with asyncio.timeout(pause_s):
                await self._closed.wait()
        except TimeoutError:
            pass

    async def close(self) -> None:
        """Close the link to the sender, so that ``items`` ends."""
        self._closed.set()
        if self._link is not None:
            self._link.abort()


class LineFeed(Feed[list[bytes]]):
    """A TCP client that yields lines of text in batches, without line ends and empty lines; it reconnects after each fault.

    ``counters``: number of connections, and of lines that were too long (``lines_too_long``).
    """

    def __init__(self, what: str, key: str, address: str) -> None:
        """Set up a client that is not connected yet; arguments and errors as in ``Feed``."""
        super().__init__(what, key, address, self._lines)

    def _lines(self) -> Callable[[bytes], Iterator[list[bytes]]]:
        rest = b""

        def decode(data: bytes) -> Iterator[list[bytes]]:
            nonlocal rest
            *lines, rest = (rest + data).split(b"\n")
            if len(rest) > LONGEST_BYTES:
                self.counters["lines_too_long"] += 1
                raise CorruptFeedError(f"a line of more than {LONGEST_BYTES} bytes")
            if lines:
                yield [line for line in lines if line.strip()]

        return decode


async def _received(reader: asyncio.StreamReader) -> bytes:
    """The next bytes. Raises OSError (or TimeoutError, a subclass) when the link is lost."""
    async with asyncio.timeout(SILENCE_S):
        data = await reader.read(_READ_BYTES)
    if not data:
        raise OSError("closed by the sender")
    return data


def _reason(error: OSError) -> str:
    if isinstance(error, TimeoutError):
        return "no answer"
    return os.strerror(error.errno).lower() if error.errno is not None and error.errno > 0 else str(error)
