"""``radron-deploy push``, ``logs`` and ``status`` as the operator uses them: output and exit codes."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
import pytest

from radron.deploy import cli
from radron.deploy.remote import Host
from radron.deploy.update import hosts, logs, push
from radron.protocol.messages import Stage
from support.computers.onboard import NEW, OLD, well
from support.computers.sshserver import LACKING, ssh_server
from support.computers.updatable import Fleet
from support.mesh.meshes import free_port

pytestmark = [pytest.mark.slow, pytest.mark.skipif(LACKING is not None, reason=LACKING or "")]


@dataclass(frozen=True)
class Said:
    """Output of a command, and its exit code."""

    code: object
    out: list[str]
    err: list[str]


Deploy = Callable[..., Said]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Host]:
    with ssh_server(tmp_path_factory.mktemp("ssh")) as found:
        yield found


@pytest.fixture
def fleet(tmp_path: Path, server: Host, monkeypatch: pytest.MonkeyPatch) -> Fleet:
    fleet = Fleet(tmp_path, server, monkeypatch)
    monkeypatch.setattr(hosts, "find_hosts", lambda names, *_: ([fleet.host(name) for name in names], None))
    monkeypatch.setattr(push, "POLL_S", 0.05)
    return fleet


@pytest.fixture
def deploy(fleet: Fleet, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Deploy:
    def run(*words: str) -> Said:
        monkeypatch.setattr(sys, "argv", ["radron-deploy", *words])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        printed = capsys.readouterr()
        return Said(ended.value.code, printed.out.splitlines(), printed.err.splitlines())

    return run


def test_a_push_tells_the_progress_of_all_and_then_what_became_of_each(fleet: Fleet, deploy: Deploy) -> None:
    (fleet.folder / "d2").mkdir()
    (fleet.folder / "d2/bad").write_text(NEW.version)
    file, manifest = fleet.bundle()
    file.with_name(f"{file.name}.json").write_bytes(msgspec.json.encode(manifest))
    said = deploy("push", "d1", "d2", "--bundle", str(file))
    assert said.code == 1
    assert said.out[0] == "d1: updated from 0.1.0 (aaaaaaaaaaaa) to 0.2.0 (bbbbbbbbbbbb), slot B"
    assert said.out[1].startswith("d2: the update to 0.2.0 (bbbbbbbbbbbb) failed after 3 attempts")
    for name in ("d1", "d2"):
        told = [line for line in said.err if line.startswith(f"{name}: ")]
        assert told[0].startswith(f"{name}: copying, ")
        assert f"{name}: copying, 100 %" in told
        assert f"{name}: starting slot B" in told
    first_ends = said.err.index("d1: starting slot B")
    assert any(line.startswith("d2: copying") for line in said.err[:first_ends])  # neither waited for the other
    again = deploy("push", "d1", "--rollback")
    assert (again.code, again.out) == (0, ["d1: updated from 0.2.0 (bbbbbbbbbbbb) to 0.1.0 (aaaaaaaaaaaa), slot A"])


def test_a_push_that_is_refused_or_interrupted_is_one_line(fleet: Fleet, deploy: Deploy, monkeypatch: pytest.MonkeyPatch) -> None:
    file, manifest = fleet.bundle()
    told = deploy("push", "d1", "--bundle", str(file))
    assert (told.code, len(told.err)) == (2, 1)
    assert told.err[0].endswith("a bundle and its .json belong together")
    file.with_name(f"{file.name}.json").write_bytes(msgspec.json.encode(manifest))
    assert deploy("push", "d1").err == ["radron-deploy: --bundle FILE or --rollback: give one of them"]

    fleet.computer("d1")
    (fleet.folder / "d1/report.json").write_bytes(
        msgspec.json.encode(msgspec.structs.replace(well(), stage=Stage.LANDED, armed=True))
    )
    told = deploy("push", "d1", "--bundle", str(file))
    assert (told.code, told.err) == (
        2,
        [
            "radron-deploy: d1 (armed): no update while a vehicle is armed or a flight is under way; nothing was sent",
        ],
    )

    async def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(push, "push", interrupted)
    told = deploy("push", "d1", "--bundle", str(file))
    assert told.code == 2
    assert told.err == [
        "radron-deploy: interrupted: what has begun on board goes on by itself; run this again to complete the copies"
    ]


def test_the_status_shows_those_that_answer_and_names_the_others(fleet: Fleet, deploy: Deploy) -> None:
    for name in ("d1", "d3"):
        fleet.computer(name)
    odd = fleet.computer("d2")
    odd.files.content["A"] = NEW
    odd.files.records.put_slot("A", NEW)
    fleet.ports["d4"] = free_port()
    told = deploy("status", "d1", "d2", "d3", "d4")
    assert told.code == 1
    rows = {line.split()[0]: line for line in told.out if line.startswith("d")}
    assert list(rows) == ["drone", "d1", "d2", "d3"]
    assert f"! {NEW}" in rows["d2"]
    assert f"! {OLD}" not in rows["d1"] + rows["d3"]
    assert len(told.err) == 1
    assert told.err[0].startswith("radron-deploy: d4 (127.0.0.1): answers, but has no SSH server at this port")


def test_records_of_all_that_answer_are_fetched_and_each_only_once(
    fleet: Fleet, deploy: Deploy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    defaults = ("flights", *(logs.fetch_logs.__defaults__ or ())[1:])
    monkeypatch.setattr(logs.fetch_logs, "__defaults__", defaults)  # in each computer's own folder
    flights = fleet.folder / "d1/flights"
    flights.mkdir(parents=True)
    (flights / "d1-1.mcap").write_bytes(b"flight" * 1000)
    fleet.ports["d2"] = free_port()
    out = tmp_path / "records"
    told = deploy("logs", "d1", "d2", "--out", str(out))
    assert (told.code, told.out) == (1, [f"d1: 1 of 1 records were new; {out / 'd1'}"])
    assert told.err[-1].startswith("radron-deploy: d2 (127.0.0.1): ")
    assert (out / "d1/d1-1.mcap").read_bytes() == b"flight" * 1000
    again = deploy("logs", "d1", "--out", str(out))
    assert (again.code, again.out) == (0, [f"d1: 0 of 1 records were new; {out / 'd1'}"])
