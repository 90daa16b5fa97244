"""A mission's content fetched from a station part by part, over a real mesh."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from radron.protocol.errors import ProtocolError
from radron.protocol.identity import Identity, Role
from radron.protocol.keys import station_key
from radron.protocol.mesh.queries import hash_of, split
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.messages import MAX_PARTS, PART_BYTES
from support.mesh.identities import identity, new_issuer
from support.mesh.meshes import SWARM, Member, endpoint, free_port, member, until

CONTENT = bytes(range(256)) * (3 * PART_BYTES // 256) + b"end"  # four parts


def fetched(serve: Callable[[Member], Awaitable[None]], content: bytes = CONTENT) -> bytes | None:
    """Entries that a drone fetches from the station "anna" while others serve something."""

    async def course() -> bytes | None:
        listen = endpoint()
        async with member("d1", listen) as d1, member(None, connect=(listen,)) as station:
            await until(lambda: station.mesh.alive == {"d1"})
            await serve(station)
            await answered(d1, station)
            return await d1.mesh.fetch_mission("anna", [hash_of(part) for part in split(content)])

    return asyncio.run(course())


async def answered(drone: Member, station: Member) -> None:
    """Wait until the drone knows that the station answers: later publications of the station come after its declaration."""
    key = station_key(SWARM, "anna", "command")
    station.mesh.publish(key, b"after")
    await until(lambda: drone.got(key))


def test_a_content_of_many_parts_comes_whole() -> None:
    assert len(split(CONTENT)) == 4
    assert fetched(lambda station: station.mesh.serve_mission("anna", split(CONTENT))) == CONTENT


def test_parts_that_are_not_what_the_operator_has_signed_are_not_taken() -> None:
    altered = CONTENT[:-1] + b"?"
    assert fetched(lambda station: station.mesh.serve_mission("anna", split(altered))) is None


def test_one_who_serves_something_else_under_the_same_name_keeps_nobody_from_the_right_one() -> None:
    async def serve(station: Member) -> None:
        await station.mesh.serve_mission("anna", [b"wrong"] * 4)
        await station.mesh.serve_mission("anna", split(CONTENT))

    assert fetched(serve) == CONTENT


def test_where_parts_are_missing_nothing_is_taken() -> None:
    assert fetched(lambda station: station.mesh.serve_mission("anna", split(CONTENT)[:-1])) is None


def test_what_is_too_large_is_told() -> None:
    assert len(split(bytes(MAX_PARTS * PART_BYTES))) == MAX_PARTS
    with pytest.raises(ProtocolError, match=r"3\.1 MB are too much to be uploaded: at most 3\.1 MB"):
        split(bytes(MAX_PARTS * PART_BYTES + 1))


def test_with_certificates_a_drone_fetches_from_an_operator(tmp_path: Path) -> None:
    """Rights let the parts through, and nothing under another key."""
    issuer = new_issuer()
    drone = identity(issuer, tmp_path, "d1")
    anna = identity(issuer, tmp_path, "anna", Role.OPERATOR)
    heard: set[str] = set()

    async def course() -> bytes | None:
        listen = f"tls/127.0.0.1:{free_port()}"
        async with joined(drone, listen, heard=heard) as d1, joined(anna, None, (listen,)) as station:
            await until(lambda: station.alive == {"d1"})
            await station.serve_mission("anna", split(CONTENT))
            station.publish(after := station_key(SWARM, "anna", "command"), b"after")
            await until(lambda: after in heard)
            return await d1.fetch_mission("anna", [hash_of(part) for part in split(CONTENT)])

    assert asyncio.run(course()) == CONTENT


class joined:  # noqa: N801
    """A mesh with an identity."""

    def __init__(self, own: Identity, listen: str | None, connect: tuple[str, ...] = (), heard: set[str] | None = None) -> None:
        """``heard``: gets the keys of incoming messages."""
        drones = ("d1",) if own.own.role is Role.DRONE else None
        self._config = MeshConfig(listen=listen, connect=connect, identity=own, drones=drones)
        self._drone = own.own.name if drones else None
        self._heard: set[str] = set() if heard is None else heard

    async def __aenter__(self) -> Mesh:
        self._mesh = await Mesh.open(self._config, SWARM, self._drone, receive=lambda key, payload: self._heard.add(key))
        return self._mesh

    async def __aexit__(self, *_: object) -> None:
        await self._mesh.close()
