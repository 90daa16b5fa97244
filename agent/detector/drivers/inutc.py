"""A detector of another package, whose readouts are in UTC."""

from __future__ import annotations

from collections.abc import AsyncIterator

from radron.agent.detector.readout import Detector, Readout
from radron.agent.owntime import Utc


class DetectorInUtc:
    """Converts the readouts of a detector from UTC to own time."""

    def __init__(self, detector: Detector, utc: Utc) -> None:
        """``utc``: the lead of UTC over own time."""
        self._detector, self._utc = detector, utc

    @property
    def problems(self) -> tuple[str, ...]:
        """Present problems of the detector, one line each."""
        return self._detector.problems

    async def readouts(self) -> AsyncIterator[Readout]:
        """Yield readouts as they arrive, until ``close`` is called."""
        async for readout in self._detector.readouts():
            yield readout.moved(-self._utc.ahead_ns)

    async def close(self) -> None:
        """Release the detector."""
        await self._detector.close()
