"""The folder of a swarm's certificate authority: certificate, encrypted key, and records of issued and revoked certificates."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import BestAvailableEncryption, Encoding, PrivateFormat, load_pem_private_key
from cryptography.x509.oid import NameOID
from msgspec.structs import replace

from radron.deploy.pki.issued import Issued
from radron.deploy.pki.release import issue_release
from radron.protocol.access import shared_mode
from radron.protocol.identity import (
    AUTHORITY_FILE,
    CERTIFICATE_FILE,
    REVOKED_FILE,
    Authority,
    IdentityError,
    Peer,
    Role,
    checked_name,
    leave_no_core_file,
    unusable,
    utc,
)
from radron.protocol.issuing import Issuer, write_file, write_identity

AUTHORITY_KEY_FILE, ISSUED_FILE = "ca-key.pem", "issued.json"
MIN_PASSPHRASE_LENGTH = 12

Passphrase = Callable[[], str]


class PkiFolder:
    """Folder of a swarm's certificate authority on disk.

    Files: ``ca.pem`` (certificate), ``ca-key.pem`` (encrypted key, unless kept elsewhere), ``issued.json`` (record of all
    certificates) and ``revoked.crl`` (revoked certificates).
    """

    def __init__(self, folder: Path, key_file: Path | None = None) -> None:
        """``key_file``: path of the key outside the folder, such as on a medium that is kept offline; None: in the folder."""
        self.folder = folder
        self.key_file = key_file if key_file is not None else folder / AUTHORITY_KEY_FILE

    def init(self, swarm: str, passphrase: Passphrase, now_ns: int) -> None:
        """Create a new certificate authority for a swarm. Its key is written in encrypted form only.

        ``passphrase``: asks for the passphrase of the key. ``now_ns``: nanoseconds UTC.

        Raises:
            IdentityError: an authority exists, the passphrase is too short, or a file cannot be written.
        """
        for file in (self.folder / AUTHORITY_FILE, self.key_file):
            if file.exists():
                raise IdentityError(f"{file}: exists, and without it no member could join; choose another folder with --pki")
        leave_no_core_file()
        issuer = Issuer.new(swarm, now_ns)
        secret = passphrase()
        if len(secret) < MIN_PASSPHRASE_LENGTH:
            raise IdentityError(
                f"the passphrase is too short: give at least {MIN_PASSPHRASE_LENGTH} characters, such as four words"
            )
        encrypted = BestAvailableEncryption(secret.encode())
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise unusable(self.folder, error, self.folder.parent) from None
        _write(self.key_file, issuer.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, encrypted), secret=True)
        _write(self.folder / AUTHORITY_FILE, issuer.authority.certificate.public_bytes(Encoding.PEM))
        self._save([])

    def issue(
        self, name: str, role: Role, days: int | None, out: Path, passphrase: Passphrase, now_ns: int, may_revoke: bool = False
    ) -> Issued:
        """Issue a certificate with a new key to a member, and write the member's folder ``out``.

        ``may_revoke``: an operator's right to revoke other members in flight.

        Raises:
            IdentityError: the name is another member's or was revoked; a right to revoke for another role than operator; the
                authority's key cannot be used, or its certificate is not valid now; ``out`` is another member's folder; a file
                cannot be written.
        """
        if may_revoke and role is not Role.OPERATOR:
            raise IdentityError(
                f"{name!r}: only an operator can have the right to revoke others, and this is a {role}: leave out --may-revoke"
            )
        with self._locked():
            issued = self.issued()
            _check_free(name, role, issued, now_ns)
            _check_folder(name, out)
            self._check_valid(now_ns)
            issuer = self._issuer(passphrase)
            listed = self._list(issuer, issued, now_ns)
            try:
                if role is Role.RELEASE:
                    new = issue_release(issuer, name, now_ns, days, out)
                else:
                    credentials = issuer.issue(name, role, now_ns, days, may_revoke)
                    write_identity(out, issuer.authority, credentials, listed)
                    new = _issued(credentials.peer, may_revoke)
            except OSError as error:
                reason = (error.strerror or str(error)).lower()
                raise IdentityError(f"{out}: cannot be written ({reason}); give another folder with --out") from None
            self._save([*issued, new])
        return new

    def revoke(self, name: str, passphrase: Passphrase, now_ns: int) -> list[Issued]:
        """Revoke all unexpired certificates of a member, write ``revoked.crl``, and return these certificates.

        Raises:
            IdentityError: no such certificate; the authority's key cannot be used; a file cannot be written.
        """
        with self._locked():
            issued = self.issued()
            concerned = [one for one in issued if one.name == name and one.not_after_ns > now_ns and one.revoked_ns is None]
            if not concerned:
                valid = sorted({one.name for one in issued if one.not_after_ns > now_ns and one.revoked_ns is None})
                raise IdentityError(f"{name!r} has no valid certificate; those that have: {', '.join(valid) or 'none'}")
            issued = [replace(one, revoked_ns=now_ns) if one in concerned else one for one in issued]
            issuer = self._issuer(passphrase)
            self._save(issued)  # first: a listed name must not be issued again
            self._list(issuer, issued, now_ns)
        return concerned

    def authority(self) -> Authority:
        """Read the certificate of the authority.

        Raises:
            IdentityError: no authority in this folder, or its certificate cannot be read.
        """
        file = self.folder / AUTHORITY_FILE
        try:
            return Authority.read(file.read_bytes())
        except FileNotFoundError:
            raise IdentityError(f"{file}: there is no authority here; run `radron-deploy pki init --pki {self.folder}`") from None
        except OSError as error:
            raise unusable(file, error) from None
        except IdentityError as error:
            raise IdentityError(f"{file}: {error}; restore it from a backup") from None

    def issued(self) -> list[Issued]:
        """Return the record of all issued certificates, in order of issue.

        Raises:
            IdentityError: no authority in this folder, or its record cannot be read.
        """
        self.authority()
        file = self.folder / ISSUED_FILE
        try:
            return msgspec.json.decode(file.read_bytes(), type=list[Issued])
        except FileNotFoundError:
            raise IdentityError(f"{file}: is missing: the record of what was issued; restore it from a backup") from None
        except OSError as error:
            raise unusable(file, error) from None
        except msgspec.DecodeError as error:
            raise IdentityError(f"{file}: cannot be read ({error}); restore it from a backup") from None

    def _check_valid(self, now_ns: int) -> None:
        """Check that the authority's certificate is valid now: certificates issued outside its time would never be valid."""
        file, certificate, now = self.folder / AUTHORITY_FILE, self.authority().certificate, utc(now_ns)
        if now >= certificate.not_valid_after_utc:
            ended = f"{certificate.not_valid_after_utc:%Y-%m-%d}"
            mend = "make a new one with `radron-deploy pki init --pki FOLDER`, and certificates for all"
            raise IdentityError(f"{file}: ended on {ended}, and this computer's clock shows {now:%Y-%m-%d}; {mend}")
        if now < certificate.not_valid_before_utc:
            begins = f"{certificate.not_valid_before_utc:%Y-%m-%d %H:%M} UTC"
            clock = f"this computer's clock shows {now:%Y-%m-%d %H:%M} UTC: set it, such as by `chronyc makestep`"
            raise IdentityError(f"{file}: not valid before {begins}, and {clock}")

    def _issuer(self, passphrase: Passphrase) -> Issuer:
        authority = self.authority()
        try:
            pem = self.key_file.read_bytes()
        except FileNotFoundError:
            raise IdentityError(f"{self.key_file}: is missing; if it is kept elsewhere, say where with --key") from None
        except OSError as error:
            raise unusable(self.key_file, error) from None
        if (mode := shared_mode(self.key_file)) is not None:
            raise IdentityError(
                f"{self.key_file}: other users can read this key (mode {mode:03o}); run `chmod 600 {self.key_file}`"
            )
        leave_no_core_file()
        secret = passphrase().encode()
        try:
            key = load_pem_private_key(pem, secret)
        except TypeError:
            mend = f"`openssl pkey -aes256 -in {self.key_file} -out NEW`, and put the new file in its place"
            raise IdentityError(f"{self.key_file}: is not encrypted; run {mend}") from None
        except ValueError:
            text = (
                "wrong passphrase, or not a key; a lost one cannot be recovered: `radron-deploy pki init` makes a new authority"
            )
            raise IdentityError(f"{self.key_file}: {text}") from None
        if not isinstance(key, Ed25519PrivateKey) or key.public_key() != authority.certificate.public_key():
            raise IdentityError(
                f"{self.key_file}: is not the key of {self.folder / AUTHORITY_FILE}; say where that is with --key"
            )
        return Issuer(authority, key)

    def _list(self, issuer: Issuer, issued: list[Issued], now_ns: int) -> bytes | None:
        """Renew and return the list of revoked, unexpired certificates; None: no certificate was ever revoked.

        Expired certificates with the right to revoke stay listed, without their names: their keys could sign revocations dated
        before the expiry.
        """
        revoked = [one for one in issued if one.revoked_ns is not None]
        if not revoked:
            return None
        names = {int(one.serial, 16): one.name for one in revoked if one.not_after_ns > now_ns}
        ended = {int(one.serial, 16): "" for one in revoked if one.may_revoke and one.not_after_ns <= now_ns}
        listed = issuer.revocation_list(names | ended, now_ns)
        _write(self.folder / REVOKED_FILE, listed)
        return listed

    def _save(self, issued: list[Issued]) -> None:
        _write(self.folder / ISSUED_FILE, msgspec.json.format(msgspec.json.encode(issued), indent=1))

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """Lock the folder, so that simultaneous commands do not lose each other's record."""
        self.authority()
        descriptor = os.open(self.folder, os.O_RDONLY)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX)
            yield
        finally:
            os.close(descriptor)


def _write(file: Path, data: bytes, secret: bool = False) -> None:
    try:
        write_file(file, data, secret)
    except OSError as error:
        raise unusable(file, error, file.parent) from None


def _check_folder(name: str, out: Path) -> None:
    """Check that a folder is not another member's, whose key would be lost."""
    try:
        held = x509.load_pem_x509_certificate((out / CERTIFICATE_FILE).read_bytes())
        holders = [attribute.value for attribute in held.subject.get_attributes_for_oid(NameOID.COMMON_NAME)]
    except (OSError, ValueError):
        return  # no member's folder
    if holders != [name]:
        raise IdentityError(f"{out}: is the folder of {', '.join(map(str, holders))}; give another one with --out")


def _issued(peer: Peer, may_revoke: bool) -> Issued:
    times = {"not_before_ns": peer.not_before_ns, "not_after_ns": peer.not_after_ns}
    return Issued(name=peer.name, role=peer.role, serial=f"{peer.serial:x}", may_revoke=may_revoke, **times)


def _check_free(name: str, role: Role, issued: list[Issued], now_ns: int) -> None:
    """Check that a name belongs to one member only and was not revoked: links are accepted by names alone."""
    checked_name(name)
    for one in issued:
        if one.name == name and one.role is not role:
            raise IdentityError(f"{name!r} is the name of a member with the role {one.role}; choose another one")
        if one.name == name and one.revoked_ns is not None and one.not_after_ns > now_ns:
            ends = utc(one.not_after_ns).date()
            raise IdentityError(f"{name!r} was revoked, and who has its key could use the name until {ends}; choose another one")
