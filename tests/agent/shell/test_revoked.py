"""Revocations survive a restart, and each drone opens its session anew in its turn."""

import asyncio
from pathlib import Path

import pytest

from radron.agent.config.drone import DroneConfig, PeerMeshConfig
from radron.agent.shell import revoked
from radron.agent.shell.links import without
from radron.agent.shell.revoked import TURNS_S, RevokedFile, exclude, turn_s
from radron.protocol.codec import decode, encode
from radron.protocol.errors import MeshError
from radron.protocol.keys import key_of
from radron.protocol.mesh.link import MeshConfig
from radron.protocol.revocations import Revocation
from support.flights.members import cones, credential, give, revocation, trusting
from support.flights.one_pilot import START_NS, pilot

BOOT = "2" * 16


def saved(folder: Path, held: tuple[Revocation, ...]) -> RevokedFile:
    """A file with a drone's saved knowledge."""

    async def course() -> RevokedFile:
        file = RevokedFile(str(folder), "d1")
        file.save(held)
        await file._saving
        return file

    return asyncio.run(course())


def test_a_restarted_drone_knows_what_was_revoked(tmp_path: Path) -> None:
    before = trusting()
    before.receive(*revocation(last={BOOT: 2}), START_NS)
    before.receive(*revocation(member="anna"), START_NS)
    saved(tmp_path / "state", before.revocations)
    after, unaware = trusting(), trusting()
    assert RevokedFile(str(tmp_path / "nowhere"), "d1").passed_on(START_NS) == ()
    for known in RevokedFile(str(tmp_path / "state"), "d1").passed_on(
        2 * START_NS - 1
    ):  # when their signer's certificate has ended
        after.receive(key_of("radron", known), encode(known), 2 * START_NS - 1)
    assert after.revocations == before.revocations
    for one in (after, unaware):
        give(one, credential(), *cones([1, 2, 3, 4]))
    assert (len(after.fusion.log), len(unaware.fusion.log)) == (3, 5)


def test_what_somebody_wrote_into_the_file_is_believed_only_as_it_was_signed(tmp_path: Path) -> None:
    _, forged = revocation(signature=bytes(64))
    saved(tmp_path, (decode(forged),))
    (known,) = RevokedFile(str(tmp_path), "d1").load()
    one = trusting()
    assert one.receive(key_of("radron", known), encode(known), START_NS).refused == "forged"


def test_a_file_of_which_nothing_can_be_verified_any_more_stays_and_ends_no_flight(tmp_path: Path) -> None:
    """The swarm has got another authority since, or flies without certificates: at each look the agent ended."""
    file = saved(tmp_path, (decode(revocation()[1]),))
    before = file.path.read_bytes()
    again = RevokedFile(str(tmp_path), "d1")
    assert again.load()
    again.save(pilot().revocations)
    assert again._saving is None
    assert file.path.read_bytes() == before


@pytest.mark.parametrize("content", [b"", b"nonsense", encode(decode(revocation()[1]))])
def test_a_file_that_cannot_be_read_is_told_and_stays(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "d1.revoked").write_bytes(content)
    file = RevokedFile(str(tmp_path), "d1")
    assert file.load() == ()
    assert "d1.revoked is not readable" in (file.problem or "")
    file.save((decode(revocation()[1]),))
    assert (tmp_path / "d1.revoked").read_bytes() == content


def test_a_disk_that_takes_nothing_is_told(tmp_path: Path) -> None:
    (tmp_path / "state").write_text("not a folder")
    file = saved(tmp_path / "state", (decode(revocation()[1]),))
    assert "revocations not saved" in (file.problem or "")


def test_without_a_folder_nothing_is_kept() -> None:
    file = RevokedFile(None, "d1")
    file.save((decode(revocation()[1]),))
    assert file.load() == ()
    assert file.problem is None


def test_the_drones_take_turns() -> None:
    for count in (1, 3, 10, 64):
        turns = [turn_s(index, count) for index in range(count)]
        assert turns[0] == 0.0
        assert turns == sorted(turns)
        assert len(set(turns)) == count
        assert turns[-1] < TURNS_S


def test_the_session_is_opened_anew_for_each_that_is_revoked_and_again_where_it_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(revoked, "LOOK_S", 0.001)
    names: set[str] = set()
    opened: list[frozenset[str]] = []
    failures = [1]

    async def reopen(without: frozenset[str]) -> None:
        if failures[0]:
            failures[0] -= 1
            raise MeshError("port in use")
        opened.append(without)

    async def until_opened(count: int) -> None:
        while len(opened) < count:
            await asyncio.sleep(0.001)

    async def course() -> None:
        known = frozenset({"d9"})
        names.update({*known, "d3"})
        excluding = asyncio.create_task(exclude(lambda: frozenset(names), known, reopen, 0.01))
        await until_opened(1)
        names.update({"d4", "anna"})
        await until_opened(2)
        await asyncio.sleep(0.05)
        excluding.cancel()

    asyncio.run(course())
    assert opened == [{"d9", "d3"}, {"d9", "d3", "d4", "anna"}]


def test_a_revoked_drone_is_not_dialled() -> None:
    endpoints = {"d1": "tls/10.7.1.11:7447", "d2": "tls/10.7.1.12:7447", "d3": "tls/10.7.1.13:7447"}
    drone = DroneConfig(id="d3", mesh=PeerMeshConfig(endpoints=endpoints))
    links = MeshConfig(listen=endpoints["d3"], connect=(endpoints["d1"], endpoints["d2"]))
    left = without(frozenset({"d1"}), links, drone)
    assert left.connect == (endpoints["d2"],)
    assert left.revoked == {"d1"}
    assert without(frozenset(), links, drone) == links
