"""The feed's driver against a correct server, and against faulty ones."""

import asyncio
import socket
import time
from contextlib import asynccontextmanager, suppress

import pytest

from radron.agent import feed
from radron.agent.config.drone import DetectorConfig
from radron.agent.detector.drivers import open_detector
from radron.agent.detector.drivers.feed import FeedDetector
from radron.agent.detector.wire import pack
from radron.agent.errors import ConfigError
from support.sensors.detector_feed import readout_at, until


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@asynccontextmanager
async def reading(detector):
    """The readouts that the detector has given, while it is read."""
    received = []

    async def read():
        async for readout in detector.readouts():
            received.append(readout)

    task = asyncio.create_task(read())
    try:
        yield received
    finally:
        await detector.close()
        await asyncio.wait_for(task, 10.0)


@asynccontextmanager
async def serving(answer, port=0):
    """A TCP server that does ``answer(writer)`` on each connection and then keeps it open."""

    async def serve(reader, writer):
        await answer(writer)
        with suppress(OSError):
            await reader.read()
        writer.transport.abort()

    server = await asyncio.start_server(serve, "127.0.0.1", port)
    try:
        yield server.sockets[0].getsockname()[1]
    finally:
        server.close()


def test_a_feed_that_is_not_there_yet_is_reported_and_taken_up_when_it_comes():
    async def run():
        port = free_port()
        detector = FeedDetector(f"127.0.0.1:{port}")
        async with reading(detector) as received:
            await until(lambda: "refused" in detector.problems[0], "the refusal among the problems")
            assert f"127.0.0.1:{port}" in detector.problems[0]

            async def answer(writer):
                writer.write(pack(readout_at(time.time_ns())))

            async with serving(answer, port):
                await until(lambda: len(received) == 1, "the first readout")
                assert detector.problems == ()

    asyncio.run(run())


def test_a_corrupt_frame_costs_the_connection_and_nothing_else():
    async def run():
        connections = []

        async def answer(writer):
            connections.append(writer)
            if len(connections) == 1:
                writer.write(pack(readout_at(time.time_ns())) + b"\xff" * 100)
            else:
                writer.write(pack(readout_at(time.time_ns(), 5)))

        async with serving(answer) as port:
            detector = FeedDetector(f"127.0.0.1:{port}")
            async with reading(detector) as received:
                await until(lambda: len(received) == 2, "a readout of the second connection")
                assert detector.counters["corrupt_frames"] == 1
                assert [len(readout.hits) for readout in received] == [3, 5]
                assert detector.problems == ()

    asyncio.run(run())


def test_a_silent_feed_is_reported_and_left(monkeypatch):
    monkeypatch.setattr(feed, "SILENCE_S", 0.2)

    async def run():
        async def answer(writer):
            pass

        async with serving(answer) as port:
            detector = FeedDetector(f"127.0.0.1:{port}")
            async with reading(detector):
                await until(lambda: detector.counters["connections"] >= 2, "another connection")
                assert detector.problems == (f"no data from the detector at 127.0.0.1:{port} for 0.2 s",)

    asyncio.run(run())


@pytest.mark.parametrize(("age_s", "word"), [(3.0, "old"), (-3.0, "ahead of time")])
def test_readouts_of_another_time_are_dropped_counted_and_reported(age_s, word):
    async def run():
        async def answer(writer):
            writer.write(pack(readout_at(time.time_ns() - round(age_s * 1e9))))

        async with serving(answer) as port:
            detector = FeedDetector(f"127.0.0.1:{port}")
            async with reading(detector) as received:
                await until(lambda: detector.counters["dropped_stale"] == 1, "a dropped readout")
                assert word in detector.problems[0]
                assert received == []

    asyncio.run(run())


def test_close_ends_the_readouts_of_a_link_on_which_nothing_comes():
    async def run():
        async def answer(writer):
            pass

        async with serving(answer) as port:
            detector = FeedDetector(f"127.0.0.1:{port}")
            begun = time.monotonic()
            async with reading(detector):
                await until(lambda: detector.counters["connections"] == 1, "the connection")
            assert time.monotonic() - begun < feed.SILENCE_S

    asyncio.run(run())


@pytest.mark.parametrize("address", ["", "host", "host:", ":5600", "host:port", "host:70000"])
def test_an_address_that_is_none_is_an_error_with_what_is_expected(address):
    with pytest.raises(ConfigError, match=r"detector\.address"):
        open_detector(DetectorConfig(driver="feed", address=address))


def test_the_configuration_names_the_driver():
    assert open_detector(DetectorConfig()) is None
    assert isinstance(open_detector(DetectorConfig(driver="feed", address="[::1]:5600")), FeedDetector)
