"""A detector behind a TCP feed: the simulation's camera."""

from __future__ import annotations

import asyncio
import os
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable

from agent.detector.readout import Readout
from agent.detector.wire import Unpacker
from agent.errors import DetectorError

BACKOFF_S = (0.2, 2.0)  # before the first and the later attempts to connect, doubled each time
SILENCE_S = 3.0  # a feed sends five frames a second, empty ones too; a link that is silent for so long is dead
STALE_NS = 2_000_000_000  # poses are kept for 5 s: what is older may not be given a pose any more
_READ_BYTES = 1 << 18


class FeedDetector:
    """Reads the feed at ``address`` ("host:port"), reconnecting as long as it is open.

    Readouts whose end is further than 2 s from the clock are dropped and counted: for the detector chain such a gap is dead time.
    ``counters``: readouts, dropped_stale, corrupt_frames, connections.
    """

    def __init__(self, address: str, clock_ns: Callable[[], int] = time.time_ns) -> None:
        """Raises DetectorError where the address is none."""
        host, _, port = address.rpartition(":")
        if not host or not port.isdigit() or not 0 < int(port) < 65536:
            raise DetectorError(f'detector.address = {address!r}: expected "host:port"')
        self._address = address
        self._host, self._port = host.strip("[]"), int(port)
        self._clock_ns = clock_ns
        self._problem: str | None = f"no link to the detector at {address} yet"
        self._closed = asyncio.Event()
        self._link: asyncio.WriteTransport | None = None
        self.counters: Counter[str] = Counter()

    @property
    def problems(self) -> tuple[str, ...]:
        """What is wrong now, a line each."""
        return () if self._problem is None else (self._problem,)

    async def readouts(self) -> AsyncIterator[Readout]:
        """Readouts as they come, until ``close``."""
        pause_s = BACKOFF_S[0]
        while not self._closed.is_set():
            try:
                async with asyncio.timeout(SILENCE_S):
                    reader, writer = await asyncio.open_connection(self._host, self._port)
            except OSError as error:  # a TimeoutError is one too
                self._problem = f"no link to the detector at {self._address}: {_reason(error)}"
            else:
                self.counters["connections"] += 1
                self._link = writer.transport
                try:
                    async for readout in self._frames(reader):
                        pause_s = BACKOFF_S[0]
                        yield readout
                finally:
                    self._link.abort()  # nothing is sent on this link, so there is nothing to wait for
            await self._wait(pause_s)
            pause_s = min(2.0 * pause_s, BACKOFF_S[1])

    async def _frames(self, reader: asyncio.StreamReader) -> AsyncIterator[Readout]:
        """The readouts of one connection; ends, and says why in ``problems``, where it ends."""
        unpacker = Unpacker()
        while not self._closed.is_set():
            try:
                data = await self._received(reader)
                for readout in unpacker.feed(data):
                    if self._fresh(readout):
                        yield readout
            except DetectorError as error:
                self.counters["corrupt_frames"] += 1
                self._problem = f"the detector at {self._address} sends what is no feed: {error}"
                return
            except TimeoutError:
                self._problem = f"no data from the detector at {self._address} for {SILENCE_S:g} s"
                return
            except OSError as error:
                self._problem = f"lost the link to the detector at {self._address}: {_reason(error)}"
                return

    async def _received(self, reader: asyncio.StreamReader) -> bytes:
        """The next bytes. Raises OSError (or TimeoutError, which is one) where the link has gone."""
        async with asyncio.timeout(SILENCE_S):
            data = await reader.read(_READ_BYTES)
        if not data:
            raise OSError("it was closed")
        return data

    def _fresh(self, readout: Readout) -> bool:
        age_ns = self._clock_ns() - readout.end_ns
        if abs(age_ns) <= STALE_NS:
            self._problem = None
            self.counters["readouts"] += 1
            return True
        self.counters["dropped_stale"] += 1
        where = "old" if age_ns > 0 else "ahead of time"
        self._problem = (
            f"readouts of the detector at {self._address} are {abs(age_ns) * 1e-9:.1f} s {where} and are dropped; "
            "are its clock and this one's set?"
        )
        return False

    async def _wait(self, pause_s: float) -> None:
        """Sleep, but not beyond ``close``."""
        try:
            async with asyncio.timeout(pause_s):
                await self._closed.wait()
        except TimeoutError:
            pass

    async def close(self) -> None:
        """Let go of the link; ``readouts`` ends."""
        self._closed.set()
        if self._link is not None:
            self._link.abort()


def _reason(error: OSError) -> str:
    if isinstance(error, TimeoutError):
        return "it does not answer"
    return os.strerror(error.errno).lower() if error.errno is not None and error.errno > 0 else str(error)
