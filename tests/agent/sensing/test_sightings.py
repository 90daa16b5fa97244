"""Sightings from a sensor's feed: passed on unchanged, with reconnection, and bad ones never stop it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine

import msgspec
import pytest

from radron.agent.errors import ConfigError
from radron.agent.sensing.sighting_feed import SightingsFeed
from radron.agent.vehicle.interface import SeenDrone
from support.sensors.detector_feed import until
from support.sensors.line_server import LineServer, line_server

NOW_NS = 1_767_225_600_000_000_000
SEEN = SeenDrone(
    stamp_ns=NOW_NS, target="d2", direction=(0.6, 0.0, 0.8), direction_sigma_rad=0.03, range_m=12.5, range_sigma_m=0.3
)
RANGED = SeenDrone(stamp_ns=NOW_NS - 1_500_000_000, target="d3", range_m=7.0, range_sigma_m=0.2)


def line(seen: SeenDrone) -> bytes:
    return msgspec.json.encode(seen) + b"\n"


def feeding(course: Callable[[LineServer, SightingsFeed, list[SeenDrone]], Coroutine[None, None, None]]) -> None:
    """Run a course with a feed that is being read."""

    async def run() -> None:
        async with line_server() as server:
            feed, found = SightingsFeed(server.address, lambda: NOW_NS), []

            async def read() -> None:
                async for seen in feed.sightings():
                    found.extend(seen)

            reading = asyncio.create_task(read())
            await until(lambda: server.clients == 1, "connected")
            try:
                await course(server, feed, found)
            finally:
                await feed.close()
                async with asyncio.timeout(10.0):
                    await reading

    asyncio.run(run())


def test_sightings_come_through_however_the_stream_is_cut() -> None:
    async def course(server: LineServer, feed: SightingsFeed, found: list[SeenDrone]) -> None:
        data = line(SEEN) + b"\n" + line(RANGED)
        for start in range(0, len(data), 11):
            server.send(data[start : start + 11])
            await asyncio.sleep(0)
        await until(lambda: len(found) == 2, "both")
        assert found == [SEEN, RANGED]
        assert feed.problems == ()

    feeding(course)


def test_what_is_no_sighting_is_counted_and_told_and_the_next_one_comes_through() -> None:
    async def course(server: LineServer, feed: SightingsFeed, found: list[SeenDrone]) -> None:
        server.send(b'{"stamp_ns": 1\nnot json\n{"target": "d2"}\n\xff\xfe\n[' + b"[" * 3000 + b"\n")
        await until(lambda: feed.counters["malformed"] == 5, "counted")
        assert "malformed sightings" in feed.problems[0]
        server.send(line(SEEN))
        await until(lambda: found == [SEEN], "the good one")
        assert feed.problems == ()
        assert feed.counters["connections"] == 1

    feeding(course)


def test_old_ones_and_those_of_the_future_are_dropped() -> None:
    async def course(server: LineServer, feed: SightingsFeed, found: list[SeenDrone]) -> None:
        for off_ns in (-2_100_000_000, 2_100_000_000):
            server.send(line(msgspec.structs.replace(SEEN, stamp_ns=NOW_NS + off_ns)))
        await until(lambda: feed.counters["dropped_stale"] == 2, "counted")
        assert "clock" in feed.problems[0]
        assert found == []

    feeding(course)


def test_a_line_without_end_and_a_server_that_goes_lead_to_another_connection() -> None:
    async def course(server: LineServer, feed: SightingsFeed, found: list[SeenDrone]) -> None:
        server.send(b"x" * 20_000)
        await until(lambda: feed.counters["connections"] == 2, "connected again")
        assert feed.counters["lines_too_long"] == 1
        await server.close()
        await until(lambda: bool(feed.problems), "told")
        assert server.address in feed.problems[0]
        await server.start()
        await until(lambda: feed.counters["connections"] == 3 and server.clients == 1, "connected again")
        server.send(line(SEEN))
        await until(lambda: found == [SEEN], "the sighting")
        assert feed.problems == ()

    feeding(course)


@pytest.mark.parametrize("address", ["", "5600", "host:", "host:0", "host:65536", "host:five"])
def test_an_address_that_is_none_is_refused(address: str) -> None:
    with pytest.raises(ConfigError, match=r"sightings\.address"):
        SightingsFeed(address)
