"""Flight records fetched over a real SSH server."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from radron.deploy.remote import Host, RemoteError
from radron.deploy.update.logs import Fetched, fetch_logs
from support.computers.sshserver import LACKING, ssh_server

pytestmark = pytest.mark.skipif(LACKING is not None, reason=LACKING or "")


@pytest.fixture(scope="module")
def host(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Host]:
    with ssh_server(tmp_path_factory.mktemp("ssh")) as found:
        yield found


def fetch(host: Host, out: Path, flights: Path) -> Fetched:
    return asyncio.run(fetch_logs(host, out, lambda *_: None, str(flights)))


def test_records_are_fetched_once_and_one_that_grows_again(host: Host, tmp_path: Path) -> None:
    flights, out = tmp_path / "flights", tmp_path / "out"
    flights.mkdir()
    (flights / "d1-1.mcap").write_bytes(b"first" * 1000)
    (flights / "d1-2.mcap").write_bytes(b"second" * 100)
    (flights / "not-a-record.txt").write_text("x")
    (out / "d1").mkdir(parents=True)
    (out / "d1/d1-1.mcap.part").write_bytes((b"first" * 1000)[:1234])  # left by an interrupted copy
    assert fetch(host, out, flights) == Fetched(2, 2, out / "d1")
    assert fetch(host, out, flights).new == 0
    with (flights / "d1-2.mcap").open("ab") as record:
        record.write(b"more")
    assert fetch(host, out, flights).new == 1
    assert {file.name: file.read_bytes() for file in (out / "d1").iterdir()} == {
        "d1-1.mcap": b"first" * 1000,
        "d1-2.mcap": b"second" * 100 + b"more",
    }


def test_a_drone_cannot_have_its_records_written_elsewhere(host: Host, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("radron.deploy.update.logs._LIST", f"echo 5 {'0' * 64} ../../evil.mcap # {{folder}}")
    with pytest.raises(RemoteError, match=r"a record with an impossible name, '\.\./\.\./evil\.mcap': not copied"):
        fetch(host, tmp_path / "out", tmp_path)
    assert fetch_folder(tmp_path) == ["out"]


def test_a_drone_without_records_has_none(host: Host, tmp_path: Path) -> None:
    named = replace(host, name="root@10.7.1.11:22")
    assert fetch(named, tmp_path, tmp_path / "none") == Fetched(0, 0, tmp_path / "root_10.7.1.11_22")


def fetch_folder(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]
