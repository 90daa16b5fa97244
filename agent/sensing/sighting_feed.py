"""Relative observations of other drones (sightings) from a sensor's TCP feed, one JSON object per line.

{"stamp_ns": 1767225600000000000, "target": "d2", "direction": [0.98, 0.2, 0.0], "direction_sigma_rad": 0.03,
 "range_m": 12.1, "range_sigma_m": 0.3}

Direction (unit vector, body FLU) and range are as in ``radron.agent.vehicle.interface.SeenDrone``; one of them may be omitted,
with its sigma. A sensor that sees no drone sends an empty line each second.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import AsyncIterator, Callable

import msgspec
from msgspec.structs import replace

from radron.agent.feed import LineFeed
from radron.agent.owntime import Utc
from radron.agent.vehicle.interface import SeenDrone
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText, coded

STALE_NS = 2_000_000_000  # own poses are kept for 5 s: for older sightings there may be no pose
_DECODER = msgspec.json.Decoder(SeenDrone)


class SightingsFeed:
    """Receives relative observations of other drones (sightings) from a sensor's TCP feed at ``address``, and reconnects after a
    fault.

    ``counters``: sightings, malformed lines, sightings dropped as too old (``dropped_stale``), and connections.
    """

    def __init__(self, address: str, clock_ns: Callable[[], int] = time.time_ns, utc: Utc | None = None) -> None:
        """Set up the receiver; it connects when ``sightings`` is iterated.

        ``clock_ns``: own time; ``utc``: its lead; None: 0. Raises ConfigError for an invalid address.
        """
        self._utc = utc or Utc()
        self._feed = LineFeed("the sightings sensor", "sightings.address", address)
        self._clock_ns = clock_ns
        self._flaw: str | None = None
        self.counters: Counter[str] = self._feed.counters

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """The present problems of the sensor's TCP feed, one line each."""
        return coded(Code.SIGHTINGS_FEED, (text for text in (self._feed.problem, self._flaw) if text is not None))

    async def sightings(self) -> AsyncIterator[list[SeenDrone]]:
        """Yield the relative observations of other drones as they arrive, until ``close`` is called."""
        async for lines in self._feed.items():
            seen = [sighting for sighting in map(self._sighting, lines) if sighting is not None]
            self.counters["sightings"] += len(seen)
            if seen:
                self._flaw = None
                yield seen

    def _sighting(self, line: bytes) -> SeenDrone | None:
        """Parse one line; malformed lines, and lines too old for an own pose, are counted and dropped."""
        try:
            seen = _DECODER.decode(line)
        except msgspec.MsgspecError as error:
            self.counters["malformed"] += 1
            self._flaw = f"the sightings sensor sends malformed sightings: {error}"
            return None
        own_ns = self._utc.own_ns(seen.stamp_ns)
        late_ns = self._clock_ns() - own_ns
        if abs(late_ns) > STALE_NS:
            self.counters["dropped_stale"] += 1
            self._flaw = f"sightings are {late_ns * 1e-9:+.1f} s late and are dropped: check the clocks of sensor and computer"
            return None
        return replace(seen, stamp_ns=own_ns)

    async def close(self) -> None:
        """Close the link to the sensor's feed, so that ``sightings`` ends."""
        await self._feed.close()
