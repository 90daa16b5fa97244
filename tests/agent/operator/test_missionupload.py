"""A mission uploaded over a real mesh to stand-ins that take it, refuse it, or say nothing."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack
from pathlib import Path

import pytest
from msgspec.structs import replace

from radron.agent.cli import main
from radron.agent.config.loading import read_content
from radron.agent.operator import groundcontrol, missionupload
from radron.agent.operator.groundcontrol import CommandError
from radron.agent.operator.missionupload import UploadOrder
from radron.protocol.identity import Role
from radron.protocol.messages import Answer
from support.flights.one_pilot import MISSION
from support.mesh.identities import identity, new_issuer
from support.mesh.mission_receivers import Drone

NEW = replace(MISSION, name="new")


def uploaded(*drones: Drone, without: tuple[str, ...] = ()) -> tuple[dict[str, str], list[str]]:
    """The results by drone, and the messages."""
    said: list[str] = []

    async def run() -> dict[str, str]:
        async with AsyncExitStack() as stack:
            dial: tuple[str, ...] = ()
            for drone in drones:
                await stack.enter_async_context(drone.running(dial))
                dial += (drone.endpoint,)
            return await missionupload.upload(UploadOrder(NEW, dial, without), said.append)

    return asyncio.run(run()), said


def test_all_drones_get_the_mission_and_each_step_is_told() -> None:
    d1, d2 = Drone("d1"), Drone("d2")
    results, said = uploaded(d1, d2)
    assert results == {"d1": "", "d2": ""}
    assert said[0] == f"upload: to d1, d2, mission {NEW.mission_id}"
    assert sorted(said[1:]) == ["d1: has it", "d1: takes it over", "d2: has it", "d2: takes it over"]
    assert d1.content is not None
    assert read_content(d1.content, NEW.mission_id) == NEW


def test_one_that_refuses_says_why_and_the_other_has_it_all_the_same() -> None:
    results, said = uploaded(Drone("d1"), Drone("d2", refuses="its vehicle is armed"))
    assert results == {"d1": "", "d2": "refused: its vehicle is armed"}
    assert "d2: refused: its vehicle is armed" in said


def test_an_earlier_refusal_is_no_answer_to_a_new_upload() -> None:
    d1, d2 = Drone("d1"), Drone("d2")
    d1.answer = Answer(1, NEW.mission_id, "its vehicle is armed")
    assert uploaded(d1, d2)[0] == {"d1": "", "d2": ""}


def test_one_that_has_it_already_is_not_sent_it_again() -> None:
    d1, d2 = Drone("d1", has=NEW.mission_id), Drone("d2")
    results, said = uploaded(d1, d2)
    assert results == {"d1": "", "d2": ""}
    assert "d1: has it already" in said
    assert not d1.uploads


def test_one_that_begins_anew_without_it_says_so() -> None:
    results, _ = uploaded(Drone("d1"), Drone("d2", forgets=True))
    assert results["d2"] == "it has begun anew without the mission; the uploaded mission cannot be used"


def test_one_that_does_not_answer_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(missionupload, "ANSWER_S", 1.0)
    results, _ = uploaded(Drone("d1"), Drone("d2", deaf=True))
    assert results["d2"] == "does not answer: its flight record tells why (radron-agent audit)"


def test_nothing_is_sent_unless_all_drones_of_the_mission_are_heard_or_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    alone = Drone("d1")
    with monkeypatch.context() as patch:
        patch.setattr(groundcontrol, "FIND_S", 1.0)
        with pytest.raises(CommandError, match=r"upload: nothing heard from d2 at tcp/"):
            uploaded(alone)
    assert not alone.uploads
    assert uploaded(alone, without=("d2",))[0] == {"d1": ""}


def test_only_an_operators_certificate_uploads(tmp_path: Path) -> None:
    identity(new_issuer(), tmp_path, "eve", Role.OBSERVER)
    order = UploadOrder(NEW, ("tls/127.0.0.1:1",), identity=tmp_path / "eve")
    with pytest.raises(CommandError, match=r"certificate\.pem: is the certificate of eve, whose role is observer, not operator"):
        asyncio.run(missionupload.upload(order, print))


def test_a_mission_file_with_an_error_is_told_before_anything_is_sent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mission.toml").write_text('name = "x"\ndrones = [{ id = "d1" }]\narea = { polygon = [] }\n')
    links = ["--connect", "tcp/127.0.0.1:1", "--insecure"]
    monkeypatch.setattr("sys.argv", ["radron-agent", "upload", str(tmp_path / "mission.toml"), *links])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "unknown key 'area.polygon'; did you mean 'polygon_m'?" in line
