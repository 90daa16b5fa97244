"""Waiting and readouts for tests of detector drivers."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

import numpy as np

from radron.agent.detector.readout import PixelHits, Readout


async def until(condition: Callable[[], bool], what: str, seconds: float = 10.0) -> None:
    """Wait for a condition; fails with ``what`` where it does not come about in time."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, f"not within {seconds:g} s: {what}"
        await asyncio.sleep(0.01)


def readout_at(end_ns: int, number: int = 3, length_ns: int = 200_000_000) -> Readout:
    """A readout that ends at ``end_ns`` with ``number`` hits."""
    row = np.arange(number)
    hits = PixelHits(row.astype(np.int64), row.astype(np.uint16), row.astype(np.uint16) + 10)
    return Readout(end_ns - length_ns, end_ns, end_ns - length_ns, length_ns * 1e-9, hits)
