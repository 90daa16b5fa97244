"""A simulated camera that sees background, on a TCP feed, as a thread of the test."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from radron.agent.detector.readout import TICK_NS, PixelHits, Readout
from radron.agent.detector.wire import pack
from radron.sim.live.feed import ByteServer

SLICE_NS = 200_000_000
HITS_PER_S = 6.0


def readout(rng: np.random.Generator, end_ns: int, hits_per_s: float = HITS_PER_S) -> Readout:
    """Single hits at random pixels."""
    count = rng.poisson(hits_per_s * SLICE_NS * 1e-9)
    tick = np.sort((rng.integers(0, SLICE_NS, count) / TICK_NS).astype(np.int64))
    hits = PixelHits(tick, rng.integers(0, 65536, count).astype(np.uint16), np.full(count, 60, np.uint16))
    return Readout(end_ns - SLICE_NS, end_ns, end_ns - SLICE_NS, SLICE_NS * 1e-9, hits)


@contextmanager
def bench_camera(port: int) -> Iterator[None]:
    """Serve readouts on 127.0.0.1 in real time."""
    done = threading.Event()

    async def serve() -> None:
        server, rng = ByteServer(), np.random.default_rng(1)
        await server.start("127.0.0.1", port)
        end_ns = time.time_ns()
        while not done.is_set():
            end_ns += SLICE_NS
            await asyncio.sleep(max(0.0, (end_ns - time.time_ns()) * 1e-9))
            server.send_bytes(pack(readout(rng, end_ns)))
        await server.close()

    thread = threading.Thread(target=lambda: asyncio.run(serve()), daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
