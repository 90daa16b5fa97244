"""``radron-deploy pki``: files that the commands make, and errors for the user."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from types import SimpleNamespace

import pytest

from radron.deploy.cli import main
from radron.deploy.pki.authority import PkiFolder
from radron.protocol.identity import IdentityError, Role, load_identity

PASSPHRASE = "four quite ordinary words"
NOW_NS = 1_800_000_000_000_000_000
DAY_NS = 86_400_000_000_000


def given() -> str:
    return PASSPHRASE


@pytest.fixture
def pki(tmp_path: Path) -> PkiFolder:
    folder = PkiFolder(tmp_path / "pki")
    folder.init("radron", given, NOW_NS)
    return folder


def issue(pki: PkiFolder, name: str, role: Role = Role.DRONE, now_ns: int = NOW_NS, days: int | None = None) -> Path:
    out = pki.folder / name
    pki.issue(name, role, days, out, given, now_ns)
    return out


def test_members_of_one_authority_know_each_other(pki: PkiFolder) -> None:
    d1, anna = load_identity(issue(pki, "d1")), load_identity(issue(pki, "anna", Role.OPERATOR))
    assert d1.authority.verify(anna.own.der).role is Role.OPERATOR
    assert [(one.name, one.role) for one in pki.issued()] == [("d1", Role.DRONE), ("anna", Role.OPERATOR)]
    assert round((d1.own.not_after_ns - NOW_NS) / DAY_NS) == 30


def test_the_authoritys_key_is_never_written_in_clear(pki: PkiFolder) -> None:
    issue(pki, "d1")
    assert b"ENCRYPTED PRIVATE KEY" in pki.key_file.read_bytes()
    assert pki.key_file.stat().st_mode & 0o777 == 0o600
    with pytest.raises(IdentityError, match=r"ca-key.pem: wrong passphrase"):
        pki.issue("d2", Role.DRONE, None, pki.folder / "d2", lambda: "four other ordinary words", NOW_NS)
    assert not (pki.folder / "d2").exists()


def test_the_key_may_be_kept_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "stick").mkdir()
    kept = PkiFolder(tmp_path / "pki", tmp_path / "stick" / "key.pem")
    kept.init("radron", given, NOW_NS)
    assert not any(b"PRIVATE" in path.read_bytes() for path in kept.folder.iterdir())
    issue(kept, "d1")
    with pytest.raises(IdentityError, match=r"ca-key.pem: is missing.*--key"):
        issue(PkiFolder(kept.folder), "d2")


def test_a_key_that_others_can_read_is_refused(pki: PkiFolder) -> None:
    pki.key_file.chmod(0o640)
    with pytest.raises(IdentityError, match=r"ca-key.pem: other users can read this key \(mode 640\); run `chmod 600 "):
        issue(pki, "d1")
    pki.key_file.chmod(0o600)
    issue(pki, "d1")


def test_a_second_authority_does_not_replace_the_first(pki: PkiFolder) -> None:
    before = pki.key_file.read_bytes()
    with pytest.raises(IdentityError, match=r"ca.pem: exists.*--pki"):
        pki.init("radron", given, NOW_NS)
    assert pki.key_file.read_bytes() == before


def test_a_short_passphrase_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    with pytest.raises(IdentityError, match="too short"):
        PkiFolder(tmp_path / "pki").init("radron", lambda: "short", NOW_NS)
    assert not (tmp_path / "pki").exists()


def test_a_name_belongs_to_one_role(pki: PkiFolder) -> None:
    issue(pki, "anna", Role.OBSERVER)
    with pytest.raises(IdentityError, match="'anna' is the name of a member with the role observer"):
        issue(pki, "anna", Role.DRONE)


def test_renewing_makes_a_new_key(pki: PkiFolder) -> None:
    first = load_identity(issue(pki, "d1"))
    second = load_identity(issue(pki, "d1", now_ns=NOW_NS + 20 * DAY_NS))
    assert first.own.key != second.own.key
    assert second.own.not_after_ns - first.own.not_after_ns == 20 * DAY_NS


def test_a_revoked_member_is_listed_and_its_name_is_not_issued_again_while_its_key_could_be_used(pki: PkiFolder) -> None:
    d1, d2 = load_identity(issue(pki, "d1")), issue(pki, "d2")
    assert len(pki.revoke("d1", given, NOW_NS + DAY_NS)) == 1
    (d2 / "revoked.crl").write_bytes((pki.folder / "revoked.crl").read_bytes())
    revoked = load_identity(d2).revoked
    assert (revoked.names, revoked.serials) == ({"d1"}, {d1.own.serial})
    assert load_identity(issue(pki, "d3")).revoked == revoked  # a later member gets the list at once
    with pytest.raises(IdentityError, match="'d1' was revoked"):
        issue(pki, "d1", now_ns=NOW_NS + 29 * DAY_NS)
    again = load_identity(issue(pki, "d1", now_ns=NOW_NS + 31 * DAY_NS))
    assert again.revoked.names == frozenset()
    with pytest.raises(IdentityError, match=r"'d9' has no valid certificate; those that have: d1"):
        pki.revoke("d9", given, NOW_NS + 32 * DAY_NS)


def test_a_revoked_operator_who_could_revoke_others_stays_listed_when_its_certificate_has_ended(pki: PkiFolder) -> None:
    anna = pki.issue("anna", Role.OPERATOR, 10, pki.folder / "anna", given, NOW_NS, may_revoke=True)
    pki.issue("bert", Role.OPERATOR, 10, pki.folder / "bert", given, NOW_NS)  # the twin; its list entry is of no use any more
    for name in ("anna", "bert"):
        pki.revoke(name, given, NOW_NS + DAY_NS)
    later = load_identity(issue(pki, "d1", now_ns=NOW_NS + 11 * DAY_NS)).revoked
    assert later.serials == {int(anna.serial, 16)}
    assert later.names == frozenset()
    assert issue(pki, "anna", Role.OPERATOR, now_ns=NOW_NS + 12 * DAY_NS).is_dir()  # the name can be used again


@pytest.mark.parametrize("name", ["station", "D1", "../d1", "", "d" * 33, "d1/pose"])
def test_a_name_that_is_no_identifier_is_refused_before_anything_is_written(pki: PkiFolder, name: str) -> None:
    with pytest.raises(IdentityError, match="is not a name for a certificate"):
        pki.issue(name, Role.DRONE, None, pki.folder / "out", given, NOW_NS)
    assert not (pki.folder / "out").exists()


Command = Callable[..., tuple[int, str, str]]


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """Runs the command in the test's folder: exit code, standard output and error."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr("radron.deploy.pki.command.time", SimpleNamespace(time_ns=lambda: NOW_NS))

    def run(*arguments: str, passphrase: str | None = PASSPHRASE) -> tuple[int, str, str]:
        monkeypatch.setenv("RADRON_PKI_PASSPHRASE", passphrase or "")
        if passphrase is None:
            monkeypatch.delenv("RADRON_PKI_PASSPHRASE")
        monkeypatch.setattr("sys.argv", ["radron-deploy", "pki", *arguments])
        monkeypatch.setattr("sys.stdin", StringIO())
        with pytest.raises(SystemExit) as ended:
            main()
        return int(ended.value.code or 0), *capsys.readouterr()

    return run


def test_the_command_from_init_to_revoke(command: Command) -> None:
    for arguments in (["init"], ["issue", "d1", "--role", "drone"], ["issue", "anna", "--role", "operator", "--days", "2"]):
        code, told, wrong = command(*arguments)
        assert (code, wrong) == (0, "")
        assert PASSPHRASE not in told
    _, shown, _ = command("show")
    assert re.search(r"d1\W+drone\W+.*30\.0.*valid", shown)
    assert re.search(r"anna\W+operator\W+.*2\.0.*valid", shown)
    assert "d1, drone, serial" in command("show", "pki/d1")[1]
    assert "1 certificate revoked" in command("revoke", "d1")[1]
    assert re.search(r"d1\W+drone\W+.*revoked", command("show")[1])


@pytest.mark.parametrize(
    ("arguments", "passphrase", "text"),
    [
        (["issue", "d1", "--role", "drone"], None, "pki/ca-key.pem: the passphrase is missing"),
        (["issue", "d1", "--role", "drone"], "wrong", "pki/ca-key.pem: wrong passphrase"),
        (["issue", "d1", "--role", "drone", "--pki", "nowhere"], PASSPHRASE, "nowhere/ca.pem: there is no authority here; run `"),
        (["revoke", "d1"], PASSPHRASE, "'d1' has no valid certificate"),
        (["show", "nowhere"], PASSPHRASE, "nowhere: there is no such folder"),
    ],
)
def test_errors_of_the_command_end_in_one_line(
    pki: PkiFolder, command: Command, arguments: list[str], passphrase: str | None, text: str
) -> None:
    code, told, wrong = command(*arguments, passphrase=passphrase)
    assert (code, told) == (2, "")
    assert wrong.startswith(f"radron-deploy: {text}")
    assert wrong.count("\n") == 1


def test_a_folder_that_cannot_be_written_is_named_and_nothing_is_recorded(
    pki: PkiFolder, command: Command, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    code, _, error = command("issue", "d7", "--role", "drone", "--out", str(tmp_path / "file"), "--pki", str(pki.folder))
    assert (code, error) == (
        2,
        f"radron-deploy: {tmp_path / 'file'}: cannot be written (file exists); give another folder with --out\n",
    )
    assert "d7" not in {one.name for one in pki.issued()}


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["init", "--pki", "new", "--key", "stick/key.pem"], "stick/key.pem: no such file or directory; run `mkdir -p stick`"),
        (["init", "--pki", "file/new"], "file/new: not a directory; "),
        (["issue", "d1", "--role", "drone", "--key", "pki"], "pki: is a directory; name a file in it"),
        (["issue", "d2", "--role", "drone", "--out", "pki/d1"], "pki/d1: is the folder of d1; give another one with --out"),
    ],
)
def test_a_place_that_cannot_be_used_is_named_with_what_mends_it(
    pki: PkiFolder, command: Command, tmp_path: Path, arguments: list[str], text: str
) -> None:
    before = load_identity(issue(pki, "d1")).own
    (tmp_path / "file").touch()
    code, told, wrong = command(*arguments)
    assert (code, told, wrong.count("\n")) == (2, "", 1)
    assert wrong.startswith(f"radron-deploy: {text}")
    assert load_identity(tmp_path / "pki/d1").own == before
    assert command("issue", "d1", "--role", "drone", "--out", "pki/d1")[0] == 0  # the twin: it is renewed in its own folder


def test_a_disk_that_takes_nothing_is_named(pki: PkiFolder, command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(file: Path, data: bytes, secret: bool = False) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    issue(pki, "d1")
    monkeypatch.setattr("radron.deploy.pki.authority.write_file", full)
    code, _, wrong = command("revoke", "d1", "--pki", str(pki.folder))
    assert (code, wrong) == (
        2,
        f"radron-deploy: {pki.folder}/issued.json: no space left on device; see `df {pki.folder}`, or name another place\n",
    )


def test_an_authority_that_has_ended_issues_nothing(pki: PkiFolder) -> None:
    for role in (Role.DRONE, Role.RELEASE):
        with pytest.raises(IdentityError, match=r"ca\.pem: ended on 2037-\S+, and .* shows 2037-\S+; .*`radron-deploy pki init"):
            issue(pki, f"new-{role}", role, now_ns=NOW_NS + 3700 * DAY_NS)
        with pytest.raises(IdentityError, match=r"ca\.pem: not valid before 2027-.*set it, such as by `chronyc makestep`"):
            issue(pki, f"new-{role}", role, now_ns=NOW_NS - DAY_NS)
        assert issue(pki, f"new-{role}", role, now_ns=NOW_NS + 3640 * DAY_NS).is_dir()  # the twin


def test_the_right_to_revoke_in_flight_is_an_operators_and_only_where_it_was_given(pki: PkiFolder, command: Command) -> None:
    assert not load_identity(issue(pki, "bert", Role.OPERATOR)).own.may_revoke
    code, said, _ = command("issue", "anna", "--role", "operator", "--may-revoke", "--pki", str(pki.folder))
    assert (code, "anna, operator, may revoke, until" in said) == (0, True)
    assert load_identity(pki.folder / "anna").own.may_revoke
    assert "operator, may revoke" in command("show", str(pki.folder / "anna"))[1]
    code, _, error = command("issue", "d1", "--role", "drone", "--may-revoke", "--pki", str(pki.folder))
    assert (code, "only an operator can have the right to revoke others" in error) == (2, True)
