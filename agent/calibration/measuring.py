"""Measurements for a calibration: from files, or with the camera while an operator turns the drone."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path

from radron.agent.calibration.collection import Collection
from radron.agent.calibration.facing import Facing
from radron.agent.calibration.plan import is_enough
from radron.agent.calibration.result import Background
from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.files.calibration import Calibration
from radron.agent.detector.files.t3pa import T3paReader, readouts
from radron.agent.detector.readout import Detector, Readout
from radron.agent.errors import DetectorError

BACKGROUND_S = 300.0
MAX_SILENCE_S = 15.0  # of a camera; its readouts come five times a second
Tell = Callable[[str], None]


class BackgroundCount:
    """Counts the events of a camera without the source."""

    def __init__(self, calibration: Calibration, config: DetectionConfig) -> None:
        self._chain = DetectorChain(config, None, calibration)
        self._events, self._live_s = 0, 0.0

    def add(self, readout: Readout) -> None:
        """Add the events of a readout (pixel hits of one interval), measured without the source."""
        found = self._chain.process(readout)
        self._events += found.hits
        self._live_s += found.live_time_s

    @property
    def live_s(self) -> float:
        """Live time (s) for which the background has been measured so far."""
        return self._live_s

    @property
    def result(self) -> Background | None:
        """The background rate with its uncertainty; None if no time was measured."""
        if self._live_s <= 0.0:
            return None
        return Background(self._events / self._live_s, max(self._events, 1) ** 0.5 / self._live_s, self._live_s)


def file_readouts(path: Path) -> Iterator[Readout]:
    """Yield the readouts of a recording. Raises DetectorError if it cannot be read to its end, or has no hits."""
    empty = True
    for readout in readouts(T3paReader(path)):
        empty = False
        yield readout
    if empty:
        raise DetectorError(f"{path}: holds no hits")


async def measure_facing(
    opened: Callable[[], Detector], collection: Collection, facing: Facing, part: tuple[int, int], limit_s: float, tell: Tell
) -> None:
    """Measure the source in one direction with the camera, until there are enough events or the time is over.

    ``opened``: opens the camera. ``part``: number of this direction, from 1, and of all directions. ``limit_s``: longest time.
    ``tell``:
    reports the progress. Raises DetectorError if the camera delivers nothing.
    """
    collection.begin_facing()
    start_s, told_s = collection.live_s, 0.0
    async for readout in _live(opened()):
        collection.add(readout)
        measured_s = collection.live_s - start_s
        if measured_s - told_s >= 60.0:
            told_s = measured_s
            tell(f"{facing}: {measured_s:.0f} of at most {limit_s:.0f} s, {len(collection.cones[-1])} cones")
        if measured_s >= limit_s or is_enough(collection, part[0] / part[1]):
            break
    collection.end_facing()


async def measure_background(opened: Callable[[], Detector], count: BackgroundCount) -> None:
    """Count the background with the camera for ``BACKGROUND_S``. Raises DetectorError if the camera delivers nothing."""
    async for readout in _live(opened()):
        count.add(readout)
        if count.live_s >= BACKGROUND_S:
            break


async def _live(detector: Detector) -> AsyncIterator[Readout]:
    """Readouts of a detector, which is closed at the end; an error where none comes."""
    stream = detector.readouts()
    try:
        while True:
            try:
                async with asyncio.timeout(MAX_SILENCE_S):
                    yield await anext(stream)
            except StopAsyncIteration:
                return
            except TimeoutError:
                why = "; ".join(detector.problems) or "it answers, but delivers nothing"
                raise DetectorError(f"camera: no readout for {MAX_SILENCE_S:g} s: {why}") from None
    finally:
        await detector.close()
