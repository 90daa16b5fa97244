"""The camera's TCP server: with the agent's driver, and with clients that are too slow."""

import asyncio
import time

import numpy as np

from radron.agent.detector.drivers.feed import FeedDetector
from radron.agent.detector.readout import PixelHits, Readout
from radron.sim.live import feed as feed_module
from radron.sim.live.feed import FeedServer
from support.sensors.detector_feed import readout_at, until


async def unpacked(reader, number):
    """The lengths of the next frames of a connection."""
    lengths = []
    while len(lengths) < number:
        length = int.from_bytes(await asyncio.wait_for(reader.readexactly(4), 10.0), "little")
        lengths.append(length)
        await reader.readexactly(length)
    return lengths


def test_every_client_gets_every_readout_from_its_connection_on():
    async def run():
        server = FeedServer()
        port = await server.start("127.0.0.1")
        server.send(readout_at(0, 1, 0))  # no listener
        first = await asyncio.open_connection("127.0.0.1", port)
        await until(lambda: server.clients == 1, "the first client")
        server.send(readout_at(time.time_ns(), 2))
        second = await asyncio.open_connection("127.0.0.1", port)
        await until(lambda: server.clients == 2, "the second client")
        server.send(readout_at(time.time_ns(), 3))
        lengths = await unpacked(first[0], 2)
        assert lengths[1] - lengths[0] == 12
        assert await unpacked(second[0], 1) == lengths[1:]
        first[1].close()
        await until(lambda: server.clients == 1, "the first client to be gone")
        await server.close()
        assert await asyncio.wait_for(second[0].read(), 5.0) == b""

    asyncio.run(run())


def test_what_the_camera_sees_comes_to_the_agent_unchanged():
    async def run():
        server = FeedServer()
        port = await server.start("127.0.0.1")
        detector = FeedDetector(f"127.0.0.1:{port}")
        received = []

        async def read():
            async for readout in detector.readouts():
                received.append(readout)

        task = asyncio.create_task(read())
        await until(lambda: server.clients == 1, "the agent's driver")
        now_ns = time.time_ns()
        sent = [readout_at(now_ns + number * 200_000_000, number) for number in range(4)]
        for readout in sent:
            server.send(readout)
        await until(lambda: len(received) == len(sent), "all readouts")
        for there, here in zip(sent, received, strict=True):
            assert (there.start_ns, there.end_ns, there.clock_ns) == (here.start_ns, here.end_ns, here.clock_ns)
            assert there.live_time_s == here.live_time_s
            for name in ("tick", "index", "tot"):
                assert np.array_equal(getattr(there.hits, name), getattr(here.hits, name))
                assert getattr(there.hits, name).dtype == getattr(here.hits, name).dtype
        await server.close()
        await until(lambda: detector.problems != (), "the loss of the link among the problems")
        await detector.close()
        await asyncio.wait_for(task, 5.0)

    asyncio.run(run())


def test_a_client_that_does_not_read_costs_no_time_and_bounded_memory():
    count = 20_000
    hits = PixelHits(np.zeros(count, np.int64), np.zeros(count, np.uint16), np.zeros(count, np.uint16))
    frame_bytes = 12 * count

    async def run():
        server = FeedServer()
        port = await server.start("127.0.0.1")
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.transport.pause_reading()
        await until(lambda: server.clients == 1, "the client")
        (there,) = server._clients
        for number in range(200):  # 48 MB: more than the kernel's buffers take
            server.send(Readout(number, number + 1, 0, 0.0, hits))
            assert there.transport.get_write_buffer_size() <= feed_module.BACKLOG_BYTES
            if number % 10 == 0:
                await asyncio.sleep(0)
        assert server.counters["dropped"] > 0
        assert server.counters["sent"] * frame_bytes < 48e6
        await server.close()
        writer.transport.abort()
        del reader

    asyncio.run(run())


def test_a_closed_server_leaves_its_port():
    async def run():
        server = FeedServer()
        port = await server.start("127.0.0.1")
        await server.close()
        again = FeedServer()
        assert await again.start("127.0.0.1", port) == port
        await again.close()

    asyncio.run(run())
