"""A TCP relay that is cut, frozen, delayed or slow: nothing is lost, and no side is notified."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from random import Random
from typing import NamedTuple

import pytest

from radron.sim.live.relays.linkstate import PASSING, LinkState
from radron.sim.live.relays.tcp import Relay

LIMIT_S = 20.0
SHORT_S = 0.15  # for what must not happen


class Pair(NamedTuple):
    """The two ends of a connection through a relay."""

    relay: Relay
    caller: tuple[asyncio.StreamReader, asyncio.StreamWriter]
    called: tuple[asyncio.StreamReader, asyncio.StreamWriter]


@asynccontextmanager
async def listening() -> AsyncIterator[tuple[Relay, int, asyncio.Queue[tuple[asyncio.StreamReader, asyncio.StreamWriter]]]]:
    """A server, the relay to it, the relay's port, and the connections that the server gets."""
    accepted: asyncio.Queue[tuple[asyncio.StreamReader, asyncio.StreamWriter]] = asyncio.Queue()

    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await accepted.put((reader, writer))

    server = await asyncio.start_server(accept, "127.0.0.1", 0)
    relay = Relay(("127.0.0.1", server.sockets[0].getsockname()[1]), Random(1))
    port = await relay.start("127.0.0.1")
    try:
        yield relay, port, accepted
    finally:
        await relay.close()
        server.close()


def connected(work: Callable[[Pair], Awaitable[None]]) -> None:
    async def run() -> None:
        async with asyncio.timeout(LIMIT_S), listening() as (relay, port, accepted):
            caller = await asyncio.open_connection("127.0.0.1", port)
            called = await accepted.get()
            try:
                await work(Pair(relay, caller, called))
            finally:
                caller[1].close()
                called[1].close()

    asyncio.run(run())


async def silent(reader: asyncio.StreamReader) -> None:
    with pytest.raises(TimeoutError):
        await asyncio.wait_for(reader.read(100), SHORT_S)


@pytest.mark.parametrize("state", [LinkState(cut=True), LinkState(frozen=True)])
def test_one_direction_stands_still_and_loses_nothing_while_the_other_works(state: LinkState) -> None:
    async def work(pair: Pair) -> None:
        pair.caller[1].write(b"before ")
        assert await pair.called[0].readexactly(7) == b"before "
        pair.relay.there.state = state
        pair.caller[1].write(b"meanwhile ")
        pair.called[1].write(b"back")
        assert await pair.caller[0].readexactly(4) == b"back"
        await silent(pair.called[0])
        pair.relay.there.state = PASSING
        pair.caller[1].write(b"after")
        assert await pair.called[0].readexactly(15) == b"meanwhile after"

    connected(work)


def test_the_end_of_a_connection_is_not_told_before_the_cut_is_over() -> None:
    async def work(pair: Pair) -> None:
        pair.relay.there.state = pair.relay.back.state = LinkState(cut=True)
        pair.caller[1].close()
        await silent(pair.called[0])
        pair.relay.there.state = pair.relay.back.state = PASSING
        assert await pair.called[0].read() == b""

    connected(work)


def test_a_delay_with_jitter_keeps_the_order_and_is_as_long_as_asked() -> None:
    async def work(pair: Pair) -> None:
        loop = asyncio.get_running_loop()
        pair.relay.there.state = LinkState(delay_s=0.1, jitter_s=0.1)
        sent = b"".join(b"%03d" % number for number in range(50))
        began_s = loop.time()
        for place in range(0, len(sent), 3):
            pair.caller[1].write(sent[place : place + 3])
            await asyncio.sleep(0.001)
        assert await pair.called[0].readexactly(len(sent)) == sent
        assert loop.time() - began_s >= 0.1

    connected(work)


def test_a_limited_rate_is_kept_and_what_is_too_much_holds_the_sender_up() -> None:
    async def work(pair: Pair) -> None:
        loop = asyncio.get_running_loop()
        pair.relay.there.state = LinkState(rate_bytes_ps=1e6)
        began_s = loop.time()
        pair.caller[1].write(bytes(200_000))
        await pair.called[0].readexactly(200_000)
        assert loop.time() - began_s >= 0.19

    connected(work)


def test_who_dials_a_cut_link_is_not_answered_and_who_has_given_up_never_arrives() -> None:
    async def run() -> None:
        async with asyncio.timeout(LIMIT_S), listening() as (relay, port, accepted):
            relay.back.state = LinkState(cut=True)
            _, gone = await asyncio.open_connection("127.0.0.1", port)
            gone.write(b"given up")
            gone.close()
            await gone.wait_closed()
            _, patient = await asyncio.open_connection("127.0.0.1", port)
            patient.write(b"still here")
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(accepted.get(), SHORT_S)
            relay.back.state = PASSING
            reader, writer = await accepted.get()
            assert await reader.readexactly(10) == b"still here"
            assert accepted.empty()
            for each in (patient, writer):
                each.close()

    asyncio.run(run())


def test_a_caller_is_turned_away_where_nobody_listens() -> None:
    async def run() -> None:
        async with asyncio.timeout(LIMIT_S):
            relay = Relay(("127.0.0.1", 1), Random(1))
            reader, writer = await asyncio.open_connection("127.0.0.1", await relay.start("127.0.0.1"))
            with pytest.raises((ConnectionError, asyncio.IncompleteReadError)):
                await reader.readexactly(1)
            writer.close()
            await relay.close()

    asyncio.run(run())
