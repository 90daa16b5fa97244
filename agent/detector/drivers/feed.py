"""The simulated camera: a detector behind a TCP feed."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator

from radron.agent.detector.readout import Readout
from radron.agent.detector.wire import Unpacker
from radron.agent.errors import DetectorError
from radron.agent.feed import Feed
from radron.agent.owntime import Utc

READOUT_STALE_NS = 2_000_000_000  # poses are kept for 5 s: an older readout may not find its pose any more


class FeedDetector:
    """Receives the readouts of a simulated camera from a TCP feed at ``address`` ("host:port"), and reconnects after a fault.

    Readouts whose end differs from the clock by more than 2 s are dropped and counted. To the detection chain such a gap is dead
    time. ``counters``: readouts, dropped readouts (``dropped_stale``), corrupt frames, and connections.
    """

    def __init__(self, address: str, clock_ns: Callable[[], int] = time.time_ns, utc: Utc | None = None) -> None:
        """Set up the receiver; it connects when ``readouts`` is iterated.

        ``clock_ns``: own time; ``utc``: its lead; None: 0. Raises ConfigError for an invalid address.
        """
        self._utc = utc or Utc()
        self._feed = Feed("the detector", "detector.address", address, self._decoder)
        self._address = address
        self._clock_ns = clock_ns
        self._flaw: str | None = None
        self.counters: Counter[str] = self._feed.counters

    @property
    def problems(self) -> tuple[str, ...]:
        """Present problems of the camera's TCP feed, one line each."""
        problem = self._feed.problem or self._flaw
        return () if problem is None else (problem,)

    async def readouts(self) -> AsyncIterator[Readout]:
        """Yield the camera's readouts (pixel hits of one interval) as they arrive, until ``close`` is called."""
        async for readout in self._feed.items():
            in_own_time = readout.moved(-self._utc.ahead_ns)
            if self._fresh(in_own_time):
                yield in_own_time

    def _decoder(self) -> Callable[[bytes], Iterator[Readout]]:
        unpacker = Unpacker()

        def decode(data: bytes) -> Iterator[Readout]:
            try:
                yield from unpacker.feed(data)
            except DetectorError:
                self.counters["corrupt_frames"] += 1
                raise

        return decode

    def _fresh(self, readout: Readout) -> bool:
        age_ns = self._clock_ns() - readout.end_ns
        if abs(age_ns) <= READOUT_STALE_NS:
            self._flaw = None
            self.counters["readouts"] += 1
            return True
        self.counters["dropped_stale"] += 1
        where = "old" if age_ns > 0 else "ahead of time"
        self._flaw = (
            f"readouts of the detector at {self._address} are {abs(age_ns) * 1e-9:.1f} s {where} and are dropped; "
            "are its clock and this one's set?"
        )
        return False

    async def close(self) -> None:
        """Close the link to the camera's feed, so that ``readouts`` ends."""
        await self._feed.close()
