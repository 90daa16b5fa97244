"""Updates of several computers over a real SSH server. The computers are files; their updater and its decisions are real."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from radron.deploy.remote import Host, RemoteError
from radron.deploy.update import hosts, push
from radron.deploy.update.errors import UpdateError
from radron.protocol.messages import Stage
from radron.protocol.onboard import Computer, Needs, Outcome, Release, Trial
from support.computers.cable import cable_to
from support.computers.onboard import NEW, OLD, well
from support.computers.sshserver import LACKING, ssh_server
from support.computers.updatable import Fleet
from support.mesh.meshes import free_port

pytestmark = [pytest.mark.slow, pytest.mark.skipif(LACKING is not None, reason=LACKING or "")]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Host]:
    with ssh_server(tmp_path_factory.mktemp("ssh")) as found:
        yield found


@pytest.fixture
def fleet(tmp_path: Path, server: Host, monkeypatch: pytest.MonkeyPatch) -> Fleet:
    return Fleet(tmp_path, server, monkeypatch)


def test_computers_are_updated_at_once_and_one_that_falls_back_is_told(fleet: Fleet) -> None:
    (fleet.folder / "d2").mkdir()
    (fleet.folder / "d2/bad").write_text(NEW.version)
    done = fleet.push("d1", "d2", bundle=fleet.bundle())
    assert [one.kind for one in done if isinstance(one, Outcome)] == ["good", "fell back"]
    assert isinstance(done[1], Outcome)
    assert "failed after 3 attempts (the agent does not report: failed): slot A runs again" in done[1].text
    assert [fleet.computer(name).files.slots.booted for name in ("d1", "d2")] == ["B", "A"]
    assert any(line.startswith("d1: copying 1000") for line in fleet.told)
    assert "d2: writing 0.2.0 (bbbbbbbbbbbb) to slot B 0/0" in fleet.told
    assert list((fleet.folder / "d1/incoming").iterdir()) == []  # the bundle is not left there

    back = fleet.push("d1", bundle=None)
    assert isinstance(back[0], Outcome)
    assert back[0].text == "updated from 0.2.0 (bbbbbbbbbbbb) to 0.1.0 (aaaaaaaaaaaa), slot A"


def test_an_interrupted_push_goes_on_where_it_was(fleet: Fleet) -> None:
    file, manifest = fleet.bundle()
    (fleet.folder / "d1/incoming").mkdir(parents=True)
    (fleet.folder / f"d1/incoming/{manifest.sha256[:16]}.raucb.part").write_bytes(file.read_bytes()[:400_000])
    (fleet.folder / "d1/incoming/of-another-bundle.raucb.part").write_bytes(b"x")
    done = fleet.push("d1", bundle=(file, manifest))
    assert isinstance(done[0], Outcome)
    assert next(line for line in fleet.told if "copying" in line) == f"d1: copying 400000/{manifest.size}"


def test_a_push_whose_link_is_lost_is_one_line_and_is_completed_by_the_next(fleet: Fleet, server: Host) -> None:
    """Data under way at the loss of the link arrive after the next copy has begun."""
    assert server.port is not None
    file, manifest = fleet.bundle(size=20_000_000)
    part = fleet.folder / f"d1/incoming/{manifest.sha256[:16]}.raucb.part"
    with cable_to(server.port) as cable:
        fleet.ports["d1"] = cable.port
        fleet.options = ("ServerAliveInterval=1", "ServerAliveCountMax=1")  # not the 15 s of a flight field
        cable.pull_after(5_000_000)
        lost = fleet.push("d1", bundle=(file, manifest))
        assert str(lost[0]) == "d1 (127.0.0.1): the connection was lost: it no longer answers; run this again"
        assert 0 < part.stat().st_size < manifest.size
        assert fleet.computer("d1").status().trial is None
        cable.plug()
        fleet.options = ()
        fleet.told.clear()
        done = fleet.push("d1", bundle=(file, manifest))
    assert isinstance(done[0], Outcome), done[0]
    assert done[0].kind == "good"
    begun = next(line for line in fleet.told if "copying" in line)
    assert not begun.startswith("d1: copying 0/")


def test_a_push_goes_on_with_an_update_that_an_earlier_one_has_begun(fleet: Fleet) -> None:
    computer, bundle = fleet.computer("d1"), fleet.bundle()
    trial = Trial(slot="B", release=NEW, before=OLD, needs=Needs(), begun_ns=1)
    computer.files.records.begin(trial)  # left by an updater that was killed: nothing goes on by itself
    assert isinstance(fleet.push("d1", bundle=bundle)[0], Outcome)
    assert any("copying" in line for line in fleet.told)

    fleet.told.clear()
    computer.files.records.begin(msgspec.structs.replace(trial, begun_ns=2))  # in the slot that runs: it is being decided

    async def decided_meanwhile() -> Outcome | RemoteError:
        pushed = asyncio.create_task(push.push([fleet.host("d1")], fleet.order(bundle)))
        while not fleet.told:
            await asyncio.sleep(0.01)
        computer.files.records.tell(Outcome(kind="good", slot="B", release=NEW, text="by itself", stamp_ns=1, begun_ns=2))
        computer.files.records.end()
        return (await pushed)[0]

    outcome = asyncio.run(decided_meanwhile())
    assert isinstance(outcome, Outcome)
    assert outcome.text == "by itself"
    assert not any("copying" in line for line in fleet.told)


def test_nothing_is_sent_while_one_of_them_flies(fleet: Fleet) -> None:
    fleet.computer("d2")
    flying = msgspec.structs.replace(well(), stage=Stage.TRACK)
    (fleet.folder / "d2/report.json").write_bytes(msgspec.json.encode(flying))
    with pytest.raises(
        UpdateError, match=r"^d2 \(track\): no update while a vehicle is armed or a flight is under way; nothing was"
    ):
        fleet.push("d1", "d2", bundle=fleet.bundle())
    assert not (fleet.folder / "d1/incoming").exists()


def test_each_refusal_is_one_line_and_changes_nothing(fleet: Fleet) -> None:
    foreign = fleet.push("d1", bundle=fleet.bundle(foreign=True))
    assert isinstance(foreign[0], RemoteError)
    assert str(foreign[0]).startswith("d1 (127.0.0.1): ")
    assert "foreign signature: it is not signed by a release certificate of this swarm's authority" in str(foreign[0])
    older = fleet.push("d1", bundle=fleet.bundle(Release(version="0.0.9")))
    assert str(older[0]) == (
        "d1 (127.0.0.1): 0.0.9 is older than what runs there, 0.1.0 (aaaaaaaaaaaa); if you mean it, add --older"
    )
    back = fleet.push("d1", bundle=None)
    assert "slot B holds no release that has worked here: nothing to go back to" in str(back[0])
    assert fleet.computer("d1").files.slots.booted == "A"
    assert fleet.computer("d1").files.records.outcome is None


def test_a_computer_that_does_not_answer_does_not_keep_the_others_from_it(fleet: Fleet) -> None:
    fleet.ports["d2"] = free_port()
    done = fleet.push("d2", "d1", bundle=fleet.bundle())
    assert str(done[0]).startswith("d2 (127.0.0.1): answers, but has no SSH server at this port")
    assert isinstance(done[1], Outcome)


def test_a_computer_that_the_agent_was_installed_on_gets_no_bundle(fleet: Fleet, monkeypatch: pytest.MonkeyPatch) -> None:
    installed = msgspec.structs.replace(fleet.computer("d1").status(), slot="", slots={})

    async def ask(_: Host) -> Computer:
        return installed

    monkeypatch.setattr(push, "ask", ask)
    done = fleet.push("d1", bundle=fleet.bundle())
    assert str(done[0]).endswith(
        "it does not run the onboard image, and has no slots: `radron-deploy install` brings it up to date"
    )
    assert not (fleet.folder / "d1/incoming").exists()


def test_a_computer_without_our_image_is_told_so(fleet: Fleet, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hosts, "PROGRAM", "/opt/radron/bin/not-there")
    done = fleet.push("d1", bundle=fleet.bundle())
    told = "d1 (127.0.0.1): is no drone yet: `radron-deploy image flash` makes its disk, or `radron-deploy install`"
    assert str(done[0]) == told
