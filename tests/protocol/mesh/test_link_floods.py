"""Connections that never become links, and members that flood: linked members are still heard, and others can join."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
import struct
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import AsyncExitStack, asynccontextmanager
from itertools import cycle
from pathlib import Path

import pytest
from zenoh.handlers import Callback

from radron.protocol.identity import load_identity
from radron.protocol.keys import ROOT, command_key, drone_key, log_query_key
from radron.protocol.mesh.rights import COMMANDS_PER_S, LOG_QUERIES_PER_S
from radron.protocol.units import STATION
from support.mesh.encrypted import Listening, endpoint, heard, joined, swarm
from support.mesh.meshes import SWARM, linked, until

MUTE_S = 4.0  # for an exchange of milliseconds; a member kept out by a flood stays out for the whole flood


def _context(folder: Path) -> ssl.SSLContext:
    """As d2."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.load_cert_chain(folder / "d2" / "certificate.pem", folder / "d2" / "key.pem")
    context.check_hostname = False
    context.load_verify_locations(folder / "d2" / "ca.pem")
    return context


def _client_hello(folder: Path) -> bytes:
    """The first bytes of a handshake, of a member."""
    sent = ssl.MemoryBIO()
    with contextlib.suppress(ssl.SSLWantReadError):
        _context(folder).wrap_bio(ssl.MemoryBIO(), sent).do_handshake()
    return sent.read()


@asynccontextmanager
async def _linked(folder: Path) -> AsyncIterator[tuple[Listening, Callable[[float], Awaitable[None]]]]:
    """d1 and d2, linked; and what tells that, whatever else is connected to d1, d2 is still heard and d3 can join in time."""
    listen = endpoint()
    async with AsyncExitStack() as stack:
        d1 = await stack.enter_async_context(joined(load_identity(folder / "d1"), listen))
        d2 = await stack.enter_async_context(joined(load_identity(folder / "d2"), connect=(listen,)))
        await linked(d1, d2)

        async def check(joins_s: float) -> None:
            d2.publish("pose", b"here")
            await until(lambda: d1.got(drone_key(SWARM, "d2", "pose")), MUTE_S)
            d3 = await stack.enter_async_context(joined(load_identity(folder / "d3"), connect=(listen,)))
            await until(lambda: "d3" in d1.mesh.alive and "d1" in d3.mesh.alive, joins_s)
            assert d1.mesh.alive == {"d2", "d3"}

        yield d1, check


def _connect(d1: Listening) -> socket.socket:
    return socket.create_connection(("127.0.0.1", int(d1.listen.rpartition(":")[2])), timeout=5.0)


async def _attacked(folder: Path, data: bytes, connections: int, joins_s: float, closed: bool = False) -> None:
    """With connections to d1 that never get through a handshake; ``closed``: they end after these bytes."""
    async with AsyncExitStack() as stack:
        d1, check = await stack.enter_async_context(_linked(folder))
        for _ in range(connections):
            link = stack.enter_context(_connect(d1))
            with contextlib.suppress(OSError):  # closed already
                link.sendall(data)
            if closed:
                link.close()
        await check(joins_s)


@pytest.mark.parametrize("sent", [0.0, 0.5], ids=["nothing", "half of a hello"])
def test_200_half_open_connections_keep_nobody_out(folder: Path, sent: float) -> None:
    hello = _client_hello(folder)
    assert len(hello) > 100
    asyncio.run(_attacked(folder, hello[: round(sent * len(hello))], 200, joins_s=10.0))


GARBAGE = b"\x00" * 2000
OVERSIZED = struct.pack(">BHH", 22, 0x0301, 16_384) + b"\x01\xff\xff\xff" + b"x" * 16_380  # a hello of 16 MB


@pytest.mark.parametrize("data", [GARBAGE, OVERSIZED], ids=["garbage", "oversized"])
def test_broken_handshakes_keep_nobody_out(folder: Path, data: bytes) -> None:
    """Zenoh accepts no link for 0.1 s after a handshake that failed (Zenoh's issue 2685): 10 of them, about 1 s."""
    asyncio.run(_attacked(folder, data, 10, joins_s=10.0))


def test_truncated_handshakes_keep_nobody_out(folder: Path) -> None:
    hello = _client_hello(folder)
    asyncio.run(_attacked(folder, hello[: len(hello) // 2], 10, joins_s=10.0, closed=True))


@pytest.mark.slow
def test_200_broken_handshakes_keep_nobody_out_for_long(folder: Path) -> None:
    asyncio.run(_attacked(folder, GARBAGE, 200, joins_s=40.0))


@contextlib.contextmanager
def _dribbling(links: list[socket.socket], data: bytes) -> Iterator[None]:
    """Send by each link one byte of the data after another, slowly, until the end of the block; read nothing."""
    ended = threading.Event()

    def dribble() -> None:
        for byte in cycle(data):
            for link in links:
                with contextlib.suppress(OSError):  # closed already
                    link.send(bytes((byte,)))
            if ended.wait(0.1):
                return

    thread = threading.Thread(target=dribble)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def test_slow_clients_before_the_handshake_keep_nobody_out(folder: Path) -> None:
    async def course() -> None:
        async with AsyncExitStack() as stack:
            d1, check = await stack.enter_async_context(_linked(folder))
            links = [stack.enter_context(_connect(d1)) for _ in range(50)]
            stack.enter_context(_dribbling(links, _client_hello(folder)))
            await check(10.0)

    asyncio.run(course())


def test_slow_clients_with_a_certificate_that_read_nothing_keep_nobody_out(folder: Path) -> None:
    """The attackers pass the TLS handshake, as a member can, and then send a byte of nonsense now and then."""

    async def course() -> None:
        async with AsyncExitStack() as stack:
            d1, check = await stack.enter_async_context(_linked(folder))
            links = []
            for _ in range(20):
                plain = stack.enter_context(_connect(d1))
                link = await asyncio.to_thread(_context(folder).wrap_socket, plain)
                links.append(stack.enter_context(link))
            stack.enter_context(_dribbling(links, bytes(100)))  # type: ignore[arg-type]
            await check(10.0)

    asyncio.run(course())


NEWS, ENTRIES, COMMANDS = drone_key(SWARM, "d2", "pose"), drone_key(SWARM, "d2", "cone"), command_key(SWARM, "d2")


@pytest.mark.parametrize("key", [NEWS, ENTRIES, COMMANDS, drone_key(SWARM, "d3", "pose"), f"{ROOT}/{SWARM}/d2/nonsense"])
def test_a_member_that_floods_loses_its_own_messages_only(folder: Path, key: str) -> None:
    """Messages within its rights are counted and reported; messages beyond them do not even arrive."""

    async def course() -> None:
        async with AsyncExitStack() as stack:
            d1, d2, d3 = await swarm(folder, stack, "d1", "d2", "d3")
            await heard(lambda: d3.publish("pose", b"first"), d1)
            ended = threading.Event()
            flooding = asyncio.create_task(asyncio.to_thread(_flood, d2, [key], ended))
            may_send = key in (NEWS, ENTRIES, COMMANDS)
            own, gaps_s, last_s, number = drone_key(SWARM, "d3", "pose"), [0.0], time.monotonic(), 0
            while number < 20 or (may_send and not d1.mesh.problems):  # how soon it loses some depends on how fast it can send
                assert number < 600, "never told"
                d3.publish("pose", b"%d" % number)
                await asyncio.sleep(0.05)
                newest = d1.got(own)[-1]
                if newest not in (b"first", b"flood") and int(newest) >= number - 1:
                    gaps_s.append(time.monotonic() - last_s)
                    last_s = time.monotonic()
                number += 1
            told = d1.mesh.problems
            ended.set()
            sent = await flooding
            assert max(gaps_s) < MUTE_S  # the flood comes from this process too, and takes the interpreter's lock from all others
            assert b"flood" not in d1.got(own)
            arrived = [payload for _, payload in d1.messages].count(b"flood")
            assert 0 < arrived < sent if may_send else arrived == 0
            assert len(gaps_s) > 10
            assert [text.partition(":")[0] for text in told] == [
                "d2 floods the mesh" if key != COMMANDS else "operator d2 floods the mesh"
            ] * may_send

    asyncio.run(course())


@pytest.mark.parametrize("names", [("operator",), tuple(f"operator{number}" for number in range(200))], ids=["one", "200"])
def test_a_flood_of_commands_under_others_names_keeps_no_command_and_no_news_from_the_drones(
    folder: Path, names: tuple[str, ...]
) -> None:
    """Commands come first, and each costs a drone a verification: so few get through from one peer, whatever their names."""

    async def course() -> None:
        async with AsyncExitStack() as stack:
            d1, d2, operator, observer = await swarm(folder, stack, "d1", "d2", "operator", "observer")
            ended, began_s, got = threading.Event(), time.monotonic(), set[bytes]()
            flooding = asyncio.create_task(
                asyncio.to_thread(_flood, observer, [command_key(SWARM, name) for name in names], ended)
            )
            while not {b"flood", b"command", b"news"} <= got:
                assert time.monotonic() < began_s + 10.0, got
                operator.mesh.publish(command_key(SWARM, "operator"), b"command")  # the twins: both are heard meanwhile
                d2.publish("pose", b"news")
                await asyncio.sleep(0.1)
                got = {payload for _, payload in d1.messages}
            arrived, seconds = [payload for _, payload in d1.messages].count(b"flood"), time.monotonic() - began_s
            ended.set()
            assert arrived < COMMANDS_PER_S * seconds + 2 < 0.5 * await flooding

    asyncio.run(course())


def _flood(member: Listening, keys: list[str], ended: threading.Event) -> int:
    sent = 0
    while not ended.is_set():
        member.mesh._session.put(keys[sent % len(keys)], b"flood")
        sent += 1
    return sent


@pytest.mark.parametrize("asked", [log_query_key(SWARM, "d1", STATION), f"{ROOT}/{SWARM}/**"])
def test_a_member_that_floods_with_queries_gets_few_answers_and_keeps_nobody_from_theirs(folder: Path, asked: str) -> None:
    """A query that reaches the agent takes time of its event loop, answered or not."""

    async def course() -> None:
        async with AsyncExitStack() as stack:
            d1, d2, observer = await swarm(folder, stack, "d1", "d2", "observer")
            ended, began_s, answered = threading.Event(), time.monotonic(), 0
            flooding = asyncio.create_task(asyncio.to_thread(_ask, observer, asked, ended))
            while answered < 5:
                answered += await d2.mesh.ask("d1", b"")  # the twin: it is answered meanwhile
                await asyncio.sleep(2.0 / LOG_QUERIES_PER_S)
            arrived = d1.mesh.counters["log_answered"] + d1.mesh.counters["log_answer_refused"]
            most = LOG_QUERIES_PER_S * (time.monotonic() - began_s) + 2 + answered
            ended.set()
            sent = await flooding
            assert arrived - answered < most < 0.5 * sent
            assert (arrived > answered) == asked.endswith(STATION)

    asyncio.run(course())


def _ask(member: Listening, key: str, ended: threading.Event) -> int:
    sent = 0
    while not ended.is_set():
        member.mesh._session.get(key, Callback(lambda _: None, indirect=False), payload=b"", timeout=1.0)
        sent += 1
    return sent
