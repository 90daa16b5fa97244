"""Encrypted links: admission, and attacks, each with a twin that shows the allowed case."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
from dataclasses import replace
from pathlib import Path

import pytest

from radron.deploy.pki.release import issue_release
from radron.protocol.errors import MeshError
from radron.protocol.identity import Identity, IdentityError, Role, load_identity
from radron.protocol.issuing import Issuer, write_identity
from radron.protocol.keys import drone_key
from radron.protocol.mesh.session import Mesh, MeshConfig
from support.mesh.encrypted import DRONES, QUIET_S, endpoint, is_let_in, joined
from support.mesh.identities import DAY_NS, Wrong, identity, new_issuer, now_ns, write_wrong
from support.mesh.meshes import SWARM, linked, until


def against_d1(folder: Path, own: Identity | None, dial: str = "") -> bool:
    """Whether d1 hears a peer that dials it; ``dial``: the dialled scheme instead, for example "tcp"."""

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
    known = (folder / "d1" / "ca.pem").read_bytes()  # one-way trust: the peer trusts d1, d1 does not trust the peer
    (tmp_path / "d3" / "ca.pem").write_bytes(known)
    assert not against_d1(folder, foreign)


def test_plain_tcp_is_not_spoken_with(folder: Path) -> None:
    assert not against_d1(folder, None, dial="tcp")


def test_a_certificate_for_releases_opens_no_links(issuer: Issuer, folder: Path, tmp_path: Path) -> None:
    issue_release(issuer, "d3", now_ns(), None, tmp_path)
    with pytest.raises(IdentityError, match=r"certificate\.pem: is for signing releases, and opens no links; make one with `"):
        load_identity(tmp_path)
    assert not against_d1(folder, _careless(load_identity(folder / "d3"), tmp_path))


def _careless(good: Identity, folder: Path) -> Identity:
    """An identity from files that ``load_identity`` refuses: an attacker's software need not."""
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
            return True  # waiting for Zenoh's first message
        except (ssl.SSLError, ConnectionError):
            return False
    return False
