"""The report on a failed link names the certificate's file, the fault and the fix; for working links there is no report."""

from __future__ import annotations

import asyncio
import re
import socket
from dataclasses import replace
from pathlib import Path

import pytest

from radron.deploy.pki.release import issue_release
from radron.protocol.identity import Identity, load_identity
from radron.protocol.issuing import Issuer
from radron.protocol.mesh.diagnosis import refusals
from support.mesh.encrypted import endpoint, joined
from support.mesh.identities import DAY_NS, identity, new_issuer, now_ns


def against_d1(folder: Path, own: Identity, d1: Identity | None = None) -> str:
    """Reports on d1, which listens."""

    async def course() -> dict[str, str]:
        listen = endpoint()
        async with joined(d1 or load_identity(folder / "d1"), listen):
            assert await refusals(load_identity(folder / "d2"), [listen], now_ns()) == {}, "the twin: d2 is let in"
            return await refusals(own, [listen], now_ns())

    (text,) = asyncio.run(course()).values()
    assert "\n" not in text
    return text


@pytest.mark.parametrize("from_days", [-40, 5], ids=["expired", "not yet valid"])
def test_an_own_certificate_that_is_not_valid_now(issuer: Issuer, folder: Path, tmp_path: Path, from_days: int) -> None:
    own = identity(issuer, tmp_path, "d3", from_ns=from_days * DAY_NS)
    assert re.fullmatch(
        rf"tls/127\.0\.0\.1:\d+ refuses {own.folder}/certificate\.pem: it is not valid now by its clock: set the clocks "
        r"\(this computer's shows [-:\d ]+ UTC\), or run `radron-deploy pki issue d3 --role drone` where the authority of all is",
        against_d1(folder, own),
    )


@pytest.mark.parametrize("name", ["s", "t"], ids=["of the same name", "of another name"])
def test_an_authority_that_is_not_that_of_the_other(folder: Path, tmp_path: Path, name: str) -> None:
    foreign = identity(new_issuer(name), tmp_path, "d3")
    text = against_d1(folder, foreign)
    assert f": its certificate is not of the authority in {foreign.folder}/ca.pem: take a folder of the same authority" in text
    (foreign.folder / "ca.pem").write_bytes((folder / "d1" / "ca.pem").read_bytes())
    assert f" refuses {foreign.folder}/certificate.pem: it is of another authority than its own: run `" in against_d1(
        folder, foreign
    )


def test_a_certificate_for_releases(issuer: Issuer, folder: Path, tmp_path: Path) -> None:
    issue_release(issuer, "builds", now_ns(), None, tmp_path)
    own = replace(load_identity(folder / "d3"), folder=tmp_path)
    assert f" refuses {tmp_path}/certificate.pem: it is not for links: run `" in against_d1(folder, own)


def test_a_peer_that_does_not_encrypt_and_one_that_is_not_there(folder: Path) -> None:
    async def course() -> dict[str, str]:
        plain, closed = endpoint(), endpoint()
        async with joined(None, plain.replace("tls", "tcp")):
            found = await refusals(load_identity(folder / "d2"), [plain, closed, "tls/nonsense"], now_ns())
        assert set(found) == {plain}
        return found

    (text,) = asyncio.run(course()).values()
    assert text.endswith(": does not encrypt its links: give --insecure, or remove mesh.insecure there")


def test_a_swarm_without_certificates_is_not_asked() -> None:
    async def course() -> dict[str, str]:
        with socket.create_server(("127.0.0.1", 0)) as listening:
            listening.setblocking(False)
            found = await refusals(None, [f"tcp/127.0.0.1:{listening.getsockname()[1]}"], now_ns())
            with pytest.raises(BlockingIOError):
                listening.accept()
            return found

    assert asyncio.run(course()) == {}
