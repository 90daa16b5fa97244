"""The detector ``pulser``: a test pulse in one pixel, in each readout; for a bench without a camera."""

import asyncio
import time
from collections.abc import AsyncIterator

import numpy as np

from radron.agent.config.drone import DetectorConfig
from radron.agent.detector.readout import SENSOR_PIXELS, TICK_NS, PixelHits, Readout

PERIOD_S = 0.05
PIXEL = SENSOR_PIXELS * SENSOR_PIXELS // 2 + SENSOR_PIXELS // 2  # in the middle
TOT = 200


class Pulser:
    def __init__(self, config: DetectorConfig) -> None:
        self._open = True  # this one needs nothing of the configuration

    @property
    def problems(self) -> tuple[str, ...]:
        return ()

    async def readouts(self) -> AsyncIterator[Readout]:
        clock_ns = start_ns = time.time_ns()
        while self._open:
            await asyncio.sleep(PERIOD_S)
            end_ns = time.time_ns()
            tick = round(((start_ns + end_ns) / 2 - clock_ns) / TICK_NS)
            hits = PixelHits(np.array([tick]), np.array([PIXEL], np.uint16), np.array([TOT], np.uint16))
            yield Readout(start_ns, end_ns, clock_ns, (end_ns - start_ns) * 1e-9, hits)
            start_ns = end_ns

    async def close(self) -> None:
        self._open = False
