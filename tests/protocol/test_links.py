"""Encrypted links: who gets in, what they can publish, and attacks, each with a twin that shows the allowed case."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
import struct
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from identities import DAY_NS, Wrong, identity, new_issuer, now_ns, write_wrong
from meshes import DEADLINE_S, SWARM, Member, free_port, linked, until

from protocol.errors import MeshError
from protocol.identity import Identity, Role, load_identity
from protocol.issuing import Issuer, write_identity
from protocol.keys import ROOT, command_key, drone_key
from protocol.session import Mesh, MeshConfig

DRONES = ("d1", "d2", "d3")
QUIET_S = 1.2  # in which a peer that is let in is linked many times over: it dials each 0.2 to 1 s


@pytest.fixture(scope="module")
def issuer() -> Issuer:
    return new_issuer()


@pytest.fixture(scope="module")
def folder(issuer: Issuer, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("identities")
    for name in DRONES:
        identity(issuer, folder, name)
    for role in (Role.OPERATOR, Role.OBSERVER):
        identity(issuer, folder, str(role), role)
    return folder


def endpoint(port: int | None = None) -> str:
    return f"tls/127.0.0.1:{port or free_port()}"


class Listening(Member):
    """A member, and where it listens."""

    listen = ""


@asynccontextmanager
async def joined(
    own: Identity | None,
    listen: str | None = None,
    connect: tuple[str, ...] = (),
    answers: tuple[tuple[str, bytes], ...] = (),
    drones: tuple[str, ...] | None = DRONES,
    others: tuple[str, ...] | None = None,
) -> AsyncIterator[Listening]:
    """A session with an identity; None: without encryption."""
    drone = own.own.name if own is not None and own.own.role is Role.DRONE else None
    one = Listening(drone, SWARM)
    one.listen = listen or ""
    config = MeshConfig(listen=listen, connect=connect, identity=own, drones=drones, others=others)
    one.mesh = await Mesh.open(config, SWARM, drone, receive=one.receive, answer=lambda _: list(answers))
    try:
        yield one
    finally:
        await one.mesh.close()


async def is_let_in(d1: Member, own: Identity | None, listen: str) -> bool:
    """Whether a member that dials d1 is heard by it: as a drone that is alive, or by a command."""
    async with joined(own, connect=(listen,)) as other:
        for _ in range(round(QUIET_S / 0.05)):
            other.mesh.publish(command_key(SWARM, "x"), b"command")
            if other.drone in d1.mesh.alive or d1.messages:
                return True
            await asyncio.sleep(0.05)
    return False


def against_d1(folder: Path, own: Identity | None, dial: str = "") -> bool:
    """Whether d1 hears somebody who dials it; ``dial``: what is dialled instead, such as "tcp"."""

    async def course() -> bool:
        listen = endpoint()
        async with joined(load_identity(folder / "d1"), listen) as d1:
            let_in = await is_let_in(d1, own, listen.replace("tls", dial or "tls"))
            d1.messages.clear()
            assert await is_let_in(d1, load_identity(folder / "d2"), listen), "the twin: d2 is always let in"
            return let_in

    return asyncio.run(course())


def test_a_certificate_that_has_expired(issuer: Issuer, folder: Path, tmp_path: Path) -> None:
    assert not against_d1(folder, identity(issuer, tmp_path, "d3", from_ns=-40 * DAY_NS))


def test_a_certificate_that_is_not_yet_valid(issuer: Issuer, folder: Path, tmp_path: Path) -> None:
    assert not against_d1(folder, identity(issuer, tmp_path, "d3", from_ns=5 * DAY_NS))


def test_a_certificate_of_another_authority_even_of_the_same_name(folder: Path, tmp_path: Path) -> None:
    foreign = identity(new_issuer(), tmp_path, "d3")
    assert not against_d1(folder, foreign)
    known = (folder / "d1" / "ca.pem").read_bytes()  # it trusts d1, but d1 does not trust it
    (tmp_path / "d3" / "ca.pem").write_bytes(known)
    assert not against_d1(folder, foreign)


def test_plain_tcp_is_not_spoken_with(folder: Path) -> None:
    assert not against_d1(folder, None, dial="tcp")


def _careless(good: Identity, folder: Path) -> Identity:
    """An identity whose files ``load_identity`` refuses: an attacker's software need not."""
    return replace(good, folder=folder)


@pytest.mark.parametrize(
    "wrong",
    [Wrong(self_signed=True), Wrong(names=()), Wrong(names=(), self_signed=True)],
    ids=["self-signed", "no name", "self-signed without a name"],
)
def test_a_certificate_that_is_no_members(issuer: Issuer, folder: Path, tmp_path: Path, wrong: Wrong) -> None:
    """Without a name, one got into Zenoh 1.7 and ended it; now it may get a link, but publishes nothing under a drone's name."""
    stranger = _careless(load_identity(folder / "d3"), write_wrong(issuer, tmp_path / "wrong", wrong))

    async def course() -> None:
        listen = endpoint()
        async with joined(load_identity(folder / "d1"), listen) as d1:
            with contextlib.suppress(MeshError):
                async with joined(stranger, connect=(listen,)) as other:
                    for _ in range(round(QUIET_S / 0.05)):
                        other.publish("pose", b"forged")
                        await asyncio.sleep(0.05)
            assert (d1.messages, d1.mesh.alive) == ([], frozenset())
            async with joined(load_identity(folder / "d3"), connect=(listen,)) as d3:
                await linked(d1, d3)

    asyncio.run(course())


async def _swarm(folder: Path, stack: AsyncExitStack, *names: str) -> list[Listening]:
    """Members that hear each other; the first ones listen."""
    ends = [endpoint() for _ in names]
    members = []
    for number, name in enumerate(names):
        own = load_identity(folder / name)
        listen = ends[number] if own.own.role is Role.DRONE else None
        answers = ((drone_key(SWARM, "d2", "cone"), b"cone of d2"),) if own.own.role is Role.DRONE else ()
        members.append(await stack.enter_async_context(joined(own, listen, tuple(ends[:number]), answers)))
    await linked(*members)
    return members


async def _heard(publish: Callable[[], None], *members: Member) -> None:
    """Publish until the members have heard it: news goes nowhere before a subscription is known."""
    before = [len(one.messages) for one in members]
    end_s = time.monotonic() + DEADLINE_S
    while any(len(one.messages) == count for one, count in zip(members, before, strict=True)):
        assert time.monotonic() < end_s, "not heard"
        publish()
        await asyncio.sleep(0.05)


def test_a_drone_publishes_under_its_own_name_only(folder: Path) -> None:
    async def course() -> None:
        async with AsyncExitStack() as stack:
            d1, d2, d3 = await _swarm(folder, stack, "d1", "d2", "d3")
            await _heard(lambda: d2.publish("pose", b"first"), d1, d3)
            for kind in ("pose", "plan", "status", "estimate", "cone", "exposure"):
                d2.mesh.publish(drone_key(SWARM, "d3", kind), b"forged")
                d2.publish(kind, b"own")
            for one in (d1, d3):
                await until(lambda one=one: [payload for _, payload in one.messages].count(b"own") == 6)  # type: ignore[misc]
                await asyncio.sleep(0.2)
                assert {payload for _, payload in one.messages} == {b"first", b"own"}
                assert all("/d2/" in key for key, _ in one.messages)

    asyncio.run(course())


def test_a_drone_declares_only_itself_alive(folder: Path) -> None:
    async def course() -> None:
        async with AsyncExitStack() as stack:
            d1, d2 = await _swarm(folder, stack, "d1", "d2")
            token = d2.mesh._session.liveliness().declare_token(drone_key(SWARM, "d3", "alive"))
            await asyncio.sleep(QUIET_S)
            assert d1.mesh.alive == {"d2"}
            token.undeclare()
            await stack.enter_async_context(joined(load_identity(folder / "d3"), connect=(d1.listen,)))
            await until(lambda: d1.mesh.alive == {"d2", "d3"})

    asyncio.run(course())


@pytest.mark.parametrize("role", [Role.OPERATOR, Role.OBSERVER])
def test_who_is_no_drone_publishes_nothing_as_one_but_hears_and_asks(folder: Path, role: Role) -> None:
    async def course() -> None:
        async with AsyncExitStack() as stack:
            d1, d2, ground = await _swarm(folder, stack, "d1", "d2", str(role))
            await _heard(lambda: ground.mesh.publish(command_key(SWARM, str(role)), b"first"), d1)
            await _heard(lambda: d2.publish("pose", b"first"), d1, ground)
            ground.mesh.publish(drone_key(SWARM, "d2", "pose"), b"forged")
            ground.mesh.publish(drone_key(SWARM, str(role), "pose"), b"forged")
            ground.mesh.publish(command_key(SWARM, str(role)), b"command")
            d2.publish("pose", b"own")
            await until(lambda: {b"own", b"command"} <= {payload for _, payload in d1.messages})
            await until(lambda: ground.got(drone_key(SWARM, "d2", "pose"))[-1] == b"own")
            assert {payload for _, payload in d1.messages} == {b"first", b"own", b"command"}
            assert await ground.mesh.ask("d1", b"") == 1
            await until(lambda: ground.got(drone_key(SWARM, "d2", "cone")))

    asyncio.run(course())


def test_entries_reach_who_joins_late_and_who_asks(folder: Path) -> None:
    """The channel of the advanced publishers and the log query work under access control."""

    async def course() -> None:
        async with AsyncExitStack() as stack:
            d1, d2 = await _swarm(folder, stack, "d1", "d2")
            for number in range(50):
                d2.publish("cone", b"%d" % number)
            await until(lambda: len(d1.got(drone_key(SWARM, "d2", "cone"))) == 50)
            ends = tuple(one.listen for one in (d1, d2))
            late = await stack.enter_async_context(joined(load_identity(folder / "d3"), endpoint(), ends))
            await until(lambda: len(late.got(drone_key(SWARM, "d2", "cone"))) == 50)
            assert await late.mesh.ask("d1", b"") == 1

    asyncio.run(course())


def test_a_revoked_drone_publishes_nothing_and_one_that_is_not_named_gets_nothing_at_all(issuer: Issuer, folder: Path) -> None:
    async def course() -> None:
        d1_own = load_identity(folder / "d1")
        revoked = replace(d1_own, revoked=replace(d1_own.revoked, names=frozenset({"d3"})))
        for others, heard in ((None, 1), (("operator",), 0)):
            listen = endpoint()
            async with (
                joined(revoked, listen, others=others) as d1,
                joined(load_identity(folder / "d2"), connect=(listen,)) as d2,
                joined(load_identity(folder / "d3"), connect=(listen,)) as d3,
                joined(load_identity(folder / "operator"), connect=(listen,)) as operator,
            ):
                await until(lambda d1=d1: "d2" in d1.mesh.alive)  # type: ignore[misc]
                await until(lambda operator=operator: "d1" in operator.mesh.alive)  # type: ignore[misc]
                for one in (d2, d3):
                    one.publish("pose", str(one.drone).encode())
                d3.mesh.publish(command_key(SWARM, "d3"), b"command of d3")
                operator.mesh.publish(command_key(SWARM, "operator"), b"command")
                await until(lambda d1=d1, heard=heard: len(d1.messages) >= 2 + heard)  # type: ignore[misc]
                d1.publish("pose", b"d1")
                await until(lambda d2=d2: len(d2.messages) >= 1)  # type: ignore[misc]
                await asyncio.sleep(0.2)
                assert "d3" not in d1.mesh.alive
                assert drone_key(SWARM, "d3", "pose") not in {key for key, _ in d1.messages}
                assert len([payload for _, payload in d1.messages if payload == b"command of d3"]) == heard
                assert len(d3.got(drone_key(SWARM, "d1", "pose"))) == heard

    asyncio.run(course())


def test_another_drones_certificate_is_refused_before_the_session_opens(folder: Path) -> None:
    async def course() -> None:
        config = MeshConfig(listen=endpoint(), identity=load_identity(folder / "d2"), drones=DRONES)
        with pytest.raises(MeshError, match=r"certificate\.pem: is the certificate of d2 \(drone\), and this drone is d1; run `"):
            await Mesh.open(config, SWARM, "d1", receive=lambda key, payload: None)

    asyncio.run(course())


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ("tcp/127.0.0.1:7447", "links are encrypted unless insecure = true; write tls/127.0.0.1:7447"),
        ("tls", "expected tls/HOST"),
    ],
)
def test_an_endpoint_that_is_not_encrypted_is_refused(folder: Path, wrong: str, text: str) -> None:
    async def course() -> None:
        for config in (
            MeshConfig(listen=wrong, identity=load_identity(folder / "d1")),
            MeshConfig(connect=(wrong,), identity=load_identity(folder / "d1")),
        ):
            with pytest.raises(MeshError, match=text):
                await Mesh.open(config, SWARM, "d1", receive=lambda key, payload: None)

    asyncio.run(course())


def _client_hello(folder: Path) -> bytes:
    """The first bytes of a handshake, of a member."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.load_cert_chain(folder / "d2" / "certificate.pem", folder / "d2" / "key.pem")
    context.check_hostname = False
    context.load_verify_locations(folder / "d2" / "ca.pem")
    sent = ssl.MemoryBIO()
    with contextlib.suppress(ssl.SSLWantReadError):
        context.wrap_bio(ssl.MemoryBIO(), sent).do_handshake()
    return sent.read()


async def _attacked(folder: Path, data: bytes, connections: int, joins_s: float) -> None:
    """Hold connections to d1 that never get through a handshake: d2, linked before, is still heard, and d3 can join."""
    listen = endpoint()
    address = ("127.0.0.1", int(listen.rpartition(":")[2]))
    async with AsyncExitStack() as stack:
        d1 = await stack.enter_async_context(joined(load_identity(folder / "d1"), listen))
        d2 = await stack.enter_async_context(joined(load_identity(folder / "d2"), connect=(listen,)))
        await linked(d1, d2)
        for _ in range(connections):
            link = stack.enter_context(socket.create_connection(address, timeout=5.0))
            with contextlib.suppress(OSError):  # closed already
                link.sendall(data)
        d2.publish("pose", b"here")
        assert await until(lambda: d1.got(drone_key(SWARM, "d2", "pose"))) < 1.0
        d3 = await stack.enter_async_context(joined(load_identity(folder / "d3"), connect=(listen,)))
        await until(lambda: "d3" in d1.mesh.alive and "d1" in d3.mesh.alive, joins_s)
        assert d1.mesh.alive == {"d2", "d3"}


@pytest.mark.parametrize("sent", [0.0, 0.5], ids=["nothing", "half of a hello"])
def test_200_half_open_connections_keep_nobody_out(folder: Path, sent: float) -> None:
    hello = _client_hello(folder)
    assert len(hello) > 100
    asyncio.run(_attacked(folder, hello[: round(sent * len(hello))], 200, joins_s=10.0))


GARBAGE = b"\x00" * 2000
OVERSIZED = struct.pack(">BHH", 22, 0x0301, 16_384) + b"\x01\xff\xff\xff" + b"x" * 16_380  # a hello of 16 MB


@pytest.mark.parametrize("data", [GARBAGE, OVERSIZED], ids=["garbage", "oversized"])
def test_broken_handshakes_keep_nobody_out(folder: Path, data: bytes) -> None:
    """Zenoh accepts nobody for 0.1 s after a handshake that failed (its issue 2685): 30 of them, about 3 s."""
    asyncio.run(_attacked(folder, data, 30, joins_s=10.0))


@pytest.mark.slow
def test_200_broken_handshakes_keep_nobody_out_for_long(folder: Path) -> None:
    asyncio.run(_attacked(folder, GARBAGE, 200, joins_s=40.0))


def test_a_certificate_that_expires_cuts_no_link_but_makes_no_new_one(issuer: Issuer, folder: Path, tmp_path: Path) -> None:
    write_identity(tmp_path, issuer.authority, issuer.issue("d2", Role.DRONE, now_ns(), days=2.0 / 86_400.0))
    short = load_identity(tmp_path)

    async def course() -> None:
        listen = endpoint()
        async with joined(load_identity(folder / "d1"), listen) as d1:
            async with joined(short, connect=(listen,)) as d2:
                await linked(d1, d2)
                await until(lambda: now_ns() > short.own.not_after_ns + 1_000_000_000)
                d2.publish("pose", b"still here")
                await until(lambda: d1.got(drone_key(SWARM, "d2", "pose")))
                assert d1.mesh.alive == {"d2"}
            await until(lambda: not d1.mesh.alive)
            d1.messages.clear()
            assert not await is_let_in(d1, short, listen)
            assert await is_let_in(d1, load_identity(folder / "d2"), listen)

    asyncio.run(course())


def test_tokens_and_queryables_of_a_drone_are_its_own_few(folder: Path) -> None:
    async def course() -> None:
        async with AsyncExitStack() as stack:
            d1, d2, d3 = await _swarm(folder, stack, "d1", "d2", "d3")
            session, seen = d2.mesh._session, list[str]()
            watched = d1.mesh._session.liveliness().declare_subscriber(
                f"{ROOT}/{SWARM}/**", lambda sample: seen.append(str(sample.key_expr)), history=True
            )
            own, foreign = drone_key(SWARM, "d2", "alive"), drone_key(SWARM, "d9", "alive")
            names = [own.replace("alive", f"alive{number}") for number in range(50)] + [foreign, f"{own}/more"]
            tokens = [session.liveliness().declare_token(name) for name in names]
            answers = session.declare_queryable(drone_key(SWARM, "d1", "log"), lambda query: query.reply(own, b"forged"))
            await until(lambda: own in seen)  # the twin
            assert await d3.mesh.ask("d1", b"") == 1  # answered by d1 alone, whose log it is
            assert not set(seen) & set(names)
            for declared in (watched, answers, *tokens):
                declared.undeclare()  # type: ignore[attr-defined]

    asyncio.run(course())


def test_a_client_without_a_certificate_gets_no_link(folder: Path) -> None:
    async def course() -> None:
        listen = endpoint()
        port = int(listen.rpartition(":")[2])
        async with joined(load_identity(folder / "d1"), listen):
            assert await asyncio.to_thread(_is_served, port, folder, True)
            assert not await asyncio.to_thread(_is_served, port, folder, False)

    asyncio.run(course())


def _is_served(port: int, folder: Path, with_certificate: bool) -> bool:
    """Whether a TLS client gets through the handshake. With TLS 1.3 a server's refusal only comes with the first read."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.load_verify_locations(folder / "d2" / "ca.pem")
    if with_certificate:
        context.load_cert_chain(folder / "d2" / "certificate.pem", folder / "d2" / "key.pem")
    with socket.create_connection(("127.0.0.1", port), timeout=5.0) as link:
        try:
            with context.wrap_socket(link) as encrypted:
                encrypted.settimeout(0.4)
                encrypted.recv(1)
        except TimeoutError:
            return True  # it waits for Zenoh's first message
        except (ssl.SSLError, ConnectionError):
            return False
    return False
