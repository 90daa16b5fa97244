"""Commands and copies over SSH, at a real server on loopback."""

from __future__ import annotations

import asyncio
import hashlib
import shlex
import socket
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from radron.deploy.remote import Host, RemoteError, at_all, fetch, run, send
from support.computers.sshserver import LACKING, ssh_server
from support.mesh.meshes import free_port

pytestmark = pytest.mark.skipif(LACKING is not None, reason=LACKING or "")


@pytest.fixture(scope="module")
def host(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Host]:
    with ssh_server(tmp_path_factory.mktemp("ssh")) as found:
        yield found


def nothing(done: int, total: int) -> None:
    """A progress display without a reader."""


def some_bytes(count: int) -> bytes:
    return hashlib.shake_256(b"radron").digest(count)


def test_a_command_gets_its_input_and_tells_what_it_says_line_by_line(host: Host) -> None:
    told: list[str] = []
    assert asyncio.run(run(host, "cat; echo done", b"one\ntwo\n", told.append)) == "one\ntwo\ndone\n"
    assert told == ["one", "two", "done"]


def test_a_command_that_fails_ends_in_the_last_line_that_it_said(host: Host) -> None:
    with pytest.raises(RemoteError, match=r"^d1 \(127\.0\.0\.1\): the disk is full$"):
        asyncio.run(run(host, "echo first >&2; echo the disk is full >&2; exit 3"))


def test_an_interrupted_copy_is_completed_and_not_begun_anew(host: Host, tmp_path: Path) -> None:
    file, target = tmp_path / "bundle", tmp_path / "there" / "a bundle"
    file.write_bytes(some_bytes(3_000_000))
    target.parent.mkdir()
    target.with_name("a bundle.part").write_bytes(some_bytes(3_000_000)[:1_000_000])
    seen: list[tuple[int, int]] = []
    asyncio.run(send(host, file, str(target), lambda done, total: seen.append((done, total))))
    assert seen[0] == (1_000_000, 3_000_000)
    assert seen[-1] == (3_000_000, 3_000_000)
    assert target.read_bytes() == file.read_bytes()
    assert [path.name for path in target.parent.iterdir()] == ["a bundle"]


def test_two_copies_at_once_make_one_whole_file(host: Host, tmp_path: Path) -> None:
    file, target = tmp_path / "bundle", tmp_path / "target"
    file.write_bytes(some_bytes(8_000_000))
    target.with_name("target.part").write_bytes(some_bytes(8_000_000)[:100_000])

    async def both() -> None:
        await asyncio.gather(*(send(host, file, str(target), nothing) for _ in range(2)))

    asyncio.run(both())
    assert target.read_bytes() == file.read_bytes()
    target.with_name("target.part").write_bytes(b"longer" * 2_000_000)
    target.unlink()
    asyncio.run(send(host, file, str(target), nothing))
    assert target.read_bytes() == file.read_bytes()


def test_a_copy_onto_something_else_is_refused_and_removed(host: Host, tmp_path: Path) -> None:
    file, target = tmp_path / "bundle", tmp_path / "target"
    file.write_bytes(some_bytes(2000))
    target.with_name("target.part").write_bytes(b"of another bundle")
    with pytest.raises(RemoteError, match="the copy of bundle differs from the file, and was removed; run this again"):
        asyncio.run(send(host, file, str(target), nothing))
    assert not target.exists()
    asyncio.run(send(host, file, str(target), nothing))
    assert target.read_bytes() == file.read_bytes()


def test_a_file_that_grows_is_fetched_as_far_as_it_was_promised(host: Host, tmp_path: Path) -> None:
    source, file = tmp_path / "flight.mcap", tmp_path / "here.mcap"
    source.write_bytes(some_bytes(900_000))
    promised = source.read_bytes()[:700_000]
    (tmp_path / "here.mcap.part").write_bytes(promised[:300_000])
    seen: list[int] = []
    sha256 = hashlib.sha256(promised).hexdigest()
    asyncio.run(fetch(host, str(source), file, len(promised), sha256, lambda done, total: seen.append(done)))
    assert seen[0] == 300_000
    assert file.read_bytes() == promised


def test_each_failure_of_the_connection_is_one_line_that_says_what_to_do(host: Host, tmp_path: Path) -> None:
    with pytest.raises(RemoteError, match=r"^d1 \(127\.0\.0\.1\): answers, but has no SSH server at this port"):
        asyncio.run(run(replace(host, port=free_port()), "true"))
    (tmp_path / "other").write_text("")
    options = tuple(f"IdentityFile={tmp_path / 'other'}" if "IdentityFile" in one else one for one in host.options)
    with pytest.raises(RemoteError, match="refuses your SSH key: put it into ssh_keys of the fleet file"):
        asyncio.run(run(replace(host, options=("IdentityAgent=none", *options)), "true"))
    asyncio.run(run(host, "true"))
    known = Path(next(one for one in host.options if "KnownHosts" in one).partition("=")[2])
    (tmp_path / "known").write_text(" ".join([known.read_text().split()[0], (known.parent / "id.pub").read_text()]))
    with pytest.raises(RemoteError, match=r"is not the computer that it was: .* `ssh-keygen -R '\[127\.0\.0\.1\]:\d+'`"):
        asyncio.run(run(replace(host, options=(f"UserKnownHostsFile={tmp_path / 'known'}", *host.options)), "true"))
    with pytest.raises(RemoteError, match=r"the connection was lost: .*; run this again"):
        asyncio.run(run(host, "kill -9 $PPID"))


def test_a_computer_that_says_nothing_is_given_up(host: Host) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:  # the kernel takes the connection, and no answer comes
        mute = replace(host, port=silent.getsockname()[1], options=("ConnectTimeout=1", *host.options))
        with pytest.raises(
            RemoteError, match=r"^d1 \(127\.0\.0\.1\): does not answer: is it switched on, and in this network\?$"
        ):
            asyncio.run(run(mute, "true"))


def test_one_computer_that_fails_does_not_keep_the_others_waiting(host: Host) -> None:
    dead = replace(host, name="d2", port=free_port())
    done = asyncio.run(at_all([dead, host], lambda one: run(one, f"echo {shlex.quote(one.name)}")))
    assert isinstance(done[0], RemoteError)
    assert done[1] == "d1\n"


def test_computers_are_named_as_in_ssh() -> None:
    assert Host.parse("10.7.1.11") == Host("10.7.1.11", "10.7.1.11")
    assert Host.parse("me@nuc:2222", ("A=b",)) == Host("me@nuc:2222", "nuc", "me", 2222, ("A=b",))
    for wrong in ("", "nuc:", "nuc:a", "-oProxyCommand=rm", "me@-x"):
        with pytest.raises(RemoteError, match="is no computer's address"):
            Host.parse(wrong)
