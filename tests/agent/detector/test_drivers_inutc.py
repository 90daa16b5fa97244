"""Readouts in UTC of another package's detector, in own time."""

import asyncio

from radron.agent.detector.drivers.inutc import DetectorInUtc
from radron.agent.detector.readout import PixelHits, Readout
from radron.agent.owntime import Utc

SECOND = 1_000_000_000
MADE = Readout(100 * SECOND, 101 * SECOND, 90 * SECOND, 1.0, PixelHits.none())


class Device:
    """``closed``: whether it was released."""

    problems = ("no sensor",)
    closed = False

    async def readouts(self):
        yield MADE
        yield MADE

    async def close(self):
        self.closed = True


def test_readouts_follow_each_step_of_the_clock():
    async def run():
        device, utc = Device(), Utc()
        detector = DetectorInUtc(device, utc)
        readouts = detector.readouts()
        assert await anext(readouts) is MADE
        utc.ahead_ns = -5 * SECOND
        then = await anext(readouts)
        assert (then.start_ns, then.end_ns, then.clock_ns) == (105 * SECOND, 106 * SECOND, 95 * SECOND)
        assert detector.problems == ("no sensor",)
        await detector.close()
        assert device.closed

    asyncio.run(run())
