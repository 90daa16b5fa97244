"""Certificates and keys: recognised members, and the report on an unusable file."""

from __future__ import annotations

import errno
import os
import pwd
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import pytest
from cryptography import x509

from radron.protocol.identity import IdentityError, Role, load_identity
from radron.protocol.issuing import Issuer, throwaway, write_identity
from support.mesh.identities import DAY_NS, Wrong, certificate, identity, new_issuer, now_ns, private_key, write_wrong


@pytest.fixture(scope="module")
def issuer() -> Issuer:
    return new_issuer()


@pytest.mark.parametrize("role", Role)
def test_name_role_and_key_are_read_from_a_certificate(issuer: Issuer, tmp_path: Path, role: Role) -> None:
    own = identity(issuer, tmp_path, "anna-1", role)
    assert (own.own.name, own.own.role) == ("anna-1", role)
    peer = issuer.authority.verify(own.own.der)
    assert peer.verified(own.sign(b"entries"), b"entries")
    assert not peer.verified(own.sign(b"entries"), b"forged")
    assert not peer.verified(b"short", b"entries")


def test_serial_numbers_are_positive_and_differ(issuer: Issuer) -> None:
    serials = {issuer.issue("d1", Role.DRONE, now_ns()).peer.serial for _ in range(50)}
    assert len(serials) == 50
    assert min(serials) > 0
    assert max(serials).bit_length() < 160
    assert issuer.authority.certificate.serial_number > 0


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("serial", [0x00, 0x80], ids=["zero", "negative"])
def test_a_certificate_whose_serial_number_is_not_positive_is_refused(issuer: Issuer, serial: int) -> None:
    """None of ours: other tools may make one, and newer versions of the library do not read it."""
    der, _ = certificate(issuer, Wrong())
    body = x509.load_der_x509_certificate(der).tbs_certificate_bytes
    changed = body.replace(b"\x02\x01\x07", bytes((2, 1, serial)), 1)
    assert changed != body
    algorithm, signature = bytes.fromhex("300506032b6570"), b"\x03\x41\x00" + issuer.key.sign(changed)
    content = changed + algorithm + signature
    with pytest.raises(IdentityError, match=r"^has a serial number that is not positive \(RFC 5280, 4\.1\.2\.2\)$"):
        issuer.authority.verify(b"\x30\x82" + len(content).to_bytes(2, "big") + content)
    assert issuer.authority.verify(der).name == "d1"


def test_times_are_those_of_the_certificate_and_never_past_those_of_the_authority(issuer: Issuer) -> None:
    begins_ns = now_ns()
    peer = issuer.issue("d1", Role.DRONE, begins_ns).peer
    assert peer.not_before_ns < begins_ns - DAY_NS // 25  # an hour earlier, for clocks that are behind
    assert abs(peer.not_after_ns - begins_ns - 30 * DAY_NS) < 2_000_000_000
    longest = issuer.issue("d1", Role.DRONE, begins_ns, days=5000).peer
    assert abs(longest.not_after_ns - begins_ns - 3650 * DAY_NS) < 10_000_000_000


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        (Wrong(), None),  # the twin of all others
        (Wrong(names=()), r"one name \(CN\)"),
        (Wrong(names=("d1", "d2")), r"one name \(CN\)"),
        (Wrong(names=("station",), alternative="station"), "not a name"),
        (Wrong(names=("d1/pose",), alternative="d1/pose"), "not a name"),
        (Wrong(roles=()), r"one role \(OU\)"),
        (Wrong(roles=("drone", "operator")), r"one role \(OU\)"),
        (Wrong(roles=("admiral",)), "unknown role 'admiral'"),
        (Wrong(alternative="d2"), r"\(SAN\) is another"),
        (Wrong(alternative=None), r"lacks its alternative name \(SAN\)"),
        (Wrong(is_authority=True), "is an authority's"),
        (Wrong(curve=True), "no Ed25519 key"),
        (Wrong(self_signed=True), "another authority"),
        (Wrong(padding=3000), "too large"),
    ],
)
def test_a_certificate_that_is_wrong_in_one_respect_is_refused(issuer: Issuer, wrong: Wrong, text: str | None) -> None:
    der, _ = certificate(issuer, wrong)
    if text is None:
        assert issuer.authority.verify(der).name == "d1"
        return
    with pytest.raises(IdentityError, match=text):
        issuer.authority.verify(der)


def test_a_foreign_authority_is_told_from_one_that_only_has_the_same_name(issuer: Issuer) -> None:
    with pytest.raises(IdentityError, match="another authority"):
        issuer.authority.verify(new_issuer("t").issue("d1", Role.DRONE, now_ns()).peer.der)
    with pytest.raises(IdentityError, match="not signed by this swarm's authority"):
        issuer.authority.verify(new_issuer().issue("d1", Role.DRONE, now_ns()).peer.der)


@pytest.mark.filterwarnings("error")
def test_broken_certificates_are_refused_and_nothing_else_happens(issuer: Issuer) -> None:
    der = issuer.issue("d1", Role.DRONE, now_ns()).peer.der
    rng = random.Random(1)
    for _ in range(2000):
        broken = bytearray(der)
        for _ in range(rng.randint(1, 3)):
            broken[rng.randrange(len(broken))] = rng.randrange(256)
        if bytes(broken) == der:
            continue
        with pytest.raises(IdentityError):
            issuer.authority.verify(bytes(broken[: rng.choice((len(der), rng.randrange(len(der))))]))


def _world_readable(folder: Path) -> None:
    (folder / "key.pem").chmod(0o644)


def _group_readable(folder: Path) -> None:
    (folder / "key.pem").chmod(0o640)


def _other_key(folder: Path) -> None:
    other = folder.parent / "other"
    issuer = new_issuer()
    write_identity(other, issuer.authority, issuer.issue("d2", Role.DRONE, now_ns()))
    shutil.copy(other / "key.pem", folder / "key.pem")


def _no_key(folder: Path) -> None:
    (folder / "key.pem").write_text("nothing")


def _foreign_authority(folder: Path) -> None:
    issuer = new_issuer("foreign")
    write_identity(folder.parent / "foreign", issuer.authority, issuer.issue("d1", Role.DRONE, now_ns()))
    shutil.copy(folder.parent / "foreign" / "ca.pem", folder / "ca.pem")


def _swapped(folder: Path) -> None:
    shutil.copy(folder / "certificate.pem", folder / "ca.pem")


def _huge(folder: Path) -> None:
    (folder / "certificate.pem").write_bytes(b"-" * 1_000_000)


def _forged_list(folder: Path) -> None:
    (folder / "revoked.crl").write_bytes(new_issuer().revocation_list({5: "d2"}, now_ns()))


@pytest.mark.parametrize(
    ("harm", "file", "text"),
    [
        (_world_readable, "key.pem", "mode 644.*run `chmod 600"),
        (_group_readable, "key.pem", "mode 640.*run `chmod 600"),
        (_other_key, "key.pem", "is not the key of certificate.pem.*radron-deploy pki issue"),
        (_no_key, "key.pem", "is not a private key.*radron-deploy pki issue"),
        (_foreign_authority, "certificate.pem", "another authority.*radron-deploy pki issue"),
        (_swapped, "ca.pem", "not the certificate of a swarm's authority.*radron-deploy pki init"),
        (_huge, "certificate.pem", "too large.*radron-deploy pki issue"),
        (_forged_list, "revoked.crl", "not signed by this swarm's authority.*copy it again"),
        (lambda folder: (folder / "key.pem").unlink(), "key.pem", "no such file.*radron-deploy pki issue"),
        (lambda folder: (folder / "ca.pem").unlink(), "ca.pem", "no such file"),
        (shutil.rmtree, "", "no such folder.*radron-deploy pki issue"),
    ],
)
def test_an_identity_that_cannot_be_used_is_told_in_one_line(
    issuer: Issuer, tmp_path: Path, harm: Callable[[Path], object], file: str, text: str
) -> None:
    folder = identity(issuer, tmp_path, "d1").folder
    assert load_identity(folder).own.name == "d1"
    harm(folder)
    with pytest.raises(IdentityError, match=text) as refused:
        load_identity(folder)
    assert str(refused.value).startswith(str(folder / file))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("file", ["ca.pem", "certificate.pem", "key.pem"])
def test_a_file_that_this_user_may_not_read_is_told_with_the_command_that_mends_it(
    issuer: Issuer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: str
) -> None:
    """As after copying with sudo. The tests may run as root, which can read everything."""
    folder, opened = identity(issuer, tmp_path, "d1").folder, Path.open

    def denied(path: Path, *arguments: Any) -> IO[Any]:
        if path.name == file:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        return opened(path, *arguments)

    assert load_identity(folder).own.name == "d1"
    monkeypatch.setattr(Path, "open", denied)
    with pytest.raises(IdentityError) as refused:
        load_identity(folder)
    user = pwd.getpwuid(os.geteuid()).pw_name
    assert str(refused.value) == f"{folder / file}: permission denied; run `sudo chown {user} {folder / file}`"


def test_a_folder_that_this_user_may_not_enter_is_told(issuer: Issuer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = identity(issuer, tmp_path / "closed", "d1").folder

    def denied(path: Path) -> bool:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    monkeypatch.setattr(Path, "is_dir", denied)
    monkeypatch.setattr(os, "access", lambda path, mode: path != tmp_path / "closed")
    with pytest.raises(IdentityError) as refused:
        load_identity(folder)
    assert str(refused.value) == f"{folder}: permission denied; run `sudo chmod a+x {tmp_path / 'closed'}`"


def test_a_certificate_without_a_name_never_reaches_zenoh(issuer: Issuer, tmp_path: Path) -> None:
    with pytest.raises(IdentityError, match=r"certificate\.pem"):
        load_identity(write_wrong(issuer, tmp_path / "nobody", Wrong(names=())))


def test_revoked_names_and_serials_are_read_with_the_identity(issuer: Issuer, tmp_path: Path) -> None:
    folder = identity(issuer, tmp_path, "d1").folder
    assert load_identity(folder).revoked.names == frozenset()
    (folder / "revoked.crl").write_bytes(issuer.revocation_list({5: "d2", 6: "d2", 7: "d3"}, now_ns()))
    revoked = load_identity(folder).revoked
    assert (revoked.serials, revoked.names) == ({5, 6, 7}, {"d2", "d3"})


def test_keys_are_never_shown(issuer: Issuer, tmp_path: Path) -> None:
    own = identity(issuer, tmp_path, "d1")
    secret = private_key(own.folder)
    for text in (repr(own), str(own), repr(own.sign), f"{own.sign}", f"{issuer}", repr(issuer.issue("d2", Role.DRONE, now_ns()))):
        assert secret.hex() not in text
        assert repr(secret)[2:-1] not in text
        assert "Private" not in text


def test_a_throwaway_authority_leaves_no_key_with_which_others_could_join(tmp_path: Path) -> None:
    throwaway({tmp_path / "d1": ("d1", Role.DRONE), tmp_path / "operator": ("operator", Role.OPERATOR)}, now_ns())
    d1, operator = load_identity(tmp_path / "d1"), load_identity(tmp_path / "operator")
    assert operator.authority.verify(d1.own.der).name == "d1"
    keys = [path for path in tmp_path.rglob("*") if path.is_file() and b"PRIVATE" in path.read_bytes()]
    assert sorted(path.parent.name for path in keys) == ["d1", "operator"]
    assert all(path.stat().st_mode & 0o777 == 0o600 for path in keys)
