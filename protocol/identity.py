"""Identities: certificates of the swarm's members, signed by the swarm's own authority (X.509, Ed25519).

The common name (CN) and a DNS entry (SAN) are the member's name, the organisational unit (OU) is its role. One key pair serves
TLS and signatures. No code here reads a clock: the verdict on an old log entry must not depend on the time of verification.
"""

from __future__ import annotations

import os
import pwd
import resource
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import Encoding, load_pem_private_key
from cryptography.utils import CryptographyDeprecationWarning
from cryptography.x509.oid import NameOID, ObjectIdentifier
from msgspec import ValidationError, convert

from radron.protocol.access import shared_mode
from radron.protocol.ed25519 import PublicKey, Signer
from radron.protocol.errors import ProtocolError
from radron.protocol.units import DroneId

AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE, REVOKED_FILE = "ca.pem", "certificate.pem", "key.pem", "revoked.crl"
REVOKED_NAME = ObjectIdentifier("2.25.177823990817045893047311286452150417643")  # in an entry of the revocation list: its name
MAY_REVOKE = ObjectIdentifier(
    "2.25.310625242103966218502359838253349438665"
)  # in a certificate: the right to revoke others in flight
MAX_CERTIFICATE_BYTES = 2048  # of a certificate; ours have about 400
_MAX_FILE_BYTES = 64 * 1024
_SERIAL = "has a serial number that is not positive (RFC 5280, 4.1.2.2)"
_UNREADABLE = (ValueError, TypeError, x509.InvalidVersion, x509.DuplicateExtension, UnsupportedAlgorithm)


class IdentityError(ProtocolError):
    """A certificate, key or revocation list cannot be used; the text names the file and the remedy."""


class Role(StrEnum):
    """The role for which a certificate is issued; it determines what the holder may do in the swarm."""

    DRONE = "drone"  # publishes under its own name
    OPERATOR = "operator"  # commands and queries
    OBSERVER = "observer"  # subscribes and queries, publishes nothing
    STATION = "station"  # a page or recorder on the ground: as an observer
    RELEASE = "release"  # signs software; no links


@dataclass(frozen=True, slots=True)
class Peer:
    """A member of the swarm (drone, operator, observer), as described by a certificate that the swarm's authority has signed.

    ``not_before_ns`` and ``not_after_ns``: period of validity in nanoseconds UTC, outside which the certificate opens no links.
    ``der``: the certificate as bytes.
    """

    name: str
    role: Role
    key: PublicKey = field(repr=False)
    serial: int
    not_before_ns: int
    not_after_ns: int
    der: bytes = field(repr=False)
    may_revoke: bool = False  # an operator's right to revoke other members in flight

    def verified(self, signature: bytes, data: bytes) -> bool:
        """Return whether ``signature`` is this member's signature of ``data``."""
        return self.key.verified(signature, data)


class Authority:
    """The certificate authority of a swarm, known by its public certificate: it has signed the certificates of all members."""

    def __init__(self, certificate: x509.Certificate) -> None:
        """Use :meth:`read` to make an authority from a file's content."""
        self.certificate = certificate

    @classmethod
    def read(cls, pem: bytes) -> Authority:
        """Read the authority's self-signed certificate.

        Raises:
            IdentityError: no self-signed certificate of an authority with an Ed25519 key.
        """
        try:
            certificate = _loaded(x509.load_pem_x509_certificate, pem)
            certificate.verify_directly_issued_by(certificate)
            is_authority = certificate.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
        except (*_UNREADABLE, InvalidSignature, x509.ExtensionNotFound):
            raise IdentityError("is not the certificate of a swarm's authority") from None
        if not is_authority or not isinstance(certificate.public_key(), Ed25519PublicKey):
            raise IdentityError("is not the certificate of a swarm's authority with an Ed25519 key")
        return cls(certificate)

    def verify(self, der: bytes) -> Peer:
        """Check that this authority has signed a certificate (DER), and return the member that the certificate describes.

        Neither the period of validity nor a revocation is checked.

        Raises:
            IdentityError: the bytes are no certificate; it is self-signed or of another authority; or it lacks a proper name or
                role.
        """
        if len(der) > MAX_CERTIFICATE_BYTES:
            raise IdentityError(f"is too large for a certificate: {len(der)} bytes")
        try:
            certificate = _loaded(x509.load_der_x509_certificate, der)
            certificate.verify_directly_issued_by(self.certificate)
            return _peer(certificate, der)
        except InvalidSignature:
            raise IdentityError("is not signed by this swarm's authority") from None
        except IdentityError:
            raise
        except _UNREADABLE as error:
            foreign = "does not match" in str(error)
            reason = "was issued by another authority" if foreign else _unread(error)
            raise IdentityError(reason) from None


@dataclass(frozen=True, slots=True)
class Revoked:
    """Serial numbers of certificates, and names of members, that the swarm's authority has revoked.

    They come from the revocation list in a member's folder.
    """

    serials: frozenset[int] = frozenset()
    names: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class Identity:
    """The certificate and the private key with which this computer takes part in the swarm, read from a folder on disk.

    ``own``: content of the own certificate. ``sign``: signs bytes with the private key.
    """

    own: Peer
    authority: Authority = field(repr=False)
    folder: Path
    sign: Signer = field(repr=False)
    revoked: Revoked = Revoked()


def leave_no_core_file() -> None:
    """Prevent core files: the kernel writes no memory of this process or its children to the disk after a crash."""
    _, most = resource.getrlimit(resource.RLIMIT_CORE)
    resource.setrlimit(resource.RLIMIT_CORE, (0, most))


def load_identity(folder: Path) -> Identity:
    """Read the certificate, the private key and the authority of this computer from a folder.

    The files are ``ca.pem``, ``certificate.pem``, ``key.pem`` and, if present, ``revoked.crl``. Core files are prevented first,
    so that a crash cannot write the key to the disk (see ``leave_no_core_file``).

    Raises:
        IdentityError: a missing or unreadable file, files that do not belong together, or a key that other users can read.
    """
    leave_no_core_file()
    authority_file, certificate_file, key_file = folder / AUTHORITY_FILE, folder / CERTIFICATE_FILE, folder / KEY_FILE
    if not _is_folder(folder):
        raise IdentityError(f"{folder}: there is no such folder; {_ISSUE}")
    try:
        authority = Authority.read(_read(authority_file))
    except IdentityError as error:
        raise _with(authority_file, error, "copy it from the folder of `radron-deploy pki init`") from None
    try:
        own = authority.verify(_der(_read(certificate_file)))
    except IdentityError as error:
        raise _with(certificate_file, error, _ISSUE) from None
    return Identity(own, authority, folder, _signer(key_file, own), _revoked(folder / REVOKED_FILE, authority))


_ISSUE = "make one with `radron-deploy pki issue NAME --role ROLE`, and copy its folder here"


def _signer(file: Path, own: Peer) -> Signer:
    pem = _read(file)
    if (mode := shared_mode(file)) is not None:
        raise IdentityError(f"{file}: other users can read this key (mode {mode:03o}); run `chmod 600 {file}`")
    try:
        key = load_pem_private_key(pem, password=None)
    except TypeError:
        raise IdentityError(f"{file}: is encrypted, and a drone starts without a passphrase; {_ISSUE}") from None
    except _UNREADABLE:
        raise IdentityError(f"{file}: is not a private key; {_ISSUE}") from None
    if not isinstance(key, Ed25519PrivateKey) or PublicKey(key.public_key()) != own.key:
        raise IdentityError(f"{file}: is not the key of {CERTIFICATE_FILE} ({own.name}); {_ISSUE}")
    return Signer(key)


def _revoked(file: Path, authority: Authority) -> Revoked:
    if not file.exists():
        return Revoked()
    try:
        return read_revoked(_read(file), authority)
    except IdentityError as error:
        raise _with(file, error, "copy it again from the folder of `radron-deploy pki init`") from None


def read_revoked(pem: bytes, authority: Authority) -> Revoked:
    """Read the authority's list of revoked certificates (CRL, PEM), and check the authority's signature.

    Raises:
        IdentityError: the text is no such list, or this authority has not signed it.
    """
    try:
        listed = x509.load_pem_x509_crl(pem)
        public = authority.certificate.public_key()
        if not isinstance(public, Ed25519PublicKey) or not listed.is_signature_valid(public):
            raise IdentityError("is not signed by this swarm's authority")
        entries = [(entry.serial_number, entry.extensions) for entry in listed]
        names = {_revoked_name(extensions) for _, extensions in entries} - {""}
    except IdentityError:
        raise
    except _UNREADABLE:
        raise IdentityError("is not a list of revoked certificates") from None
    return Revoked(frozenset(serial for serial, _ in entries), frozenset(names))


def _revoked_name(extensions: x509.Extensions) -> str:
    for extension in extensions:
        if extension.oid == REVOKED_NAME and isinstance(extension.value, x509.UnrecognizedExtension):
            return extension.value.value.decode("ascii")
    return ""


def checked_name(name: object) -> str:
    """Check that a name is allowed for a member, and return it.

    Allowed are up to 32 characters of a-z, 0-9 and '-', except the word "station", which replaces a drone's id in the keys of
    operators.

    Raises:
        IdentityError: any other name.
    """
    try:
        return convert(name, DroneId)
    except ValidationError:
        text = "use up to 32 of a-z, 0-9 and '-', and not 'station'"
        raise IdentityError(f"{str(name)[:40]!r} is not a name for a certificate: {text}") from None


def _peer(certificate: x509.Certificate, der: bytes) -> Peer:
    key = certificate.public_key()
    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    units = certificate.subject.get_attributes_for_oid(NameOID.ORGANIZATIONAL_UNIT_NAME)
    if not isinstance(key, Ed25519PublicKey):
        is_release = [unit.value for unit in units] == [Role.RELEASE]
        raise IdentityError("is for signing releases, and opens no links" if is_release else "has no Ed25519 key")
    if len(names) != 1 or len(units) != 1:
        raise IdentityError("does not have one name (CN) and one role (OU)")
    name, role = checked_name(names[0].value), str(units[0].value)
    if role not in set(Role):
        raise IdentityError(f"has the unknown role {role[:20]!r}; known: {', '.join(Role)}")
    try:
        alternatives = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        is_authority = certificate.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    except x509.ExtensionNotFound:
        raise IdentityError("lacks its alternative name (SAN) or its constraints") from None
    if is_authority or name not in alternatives.get_values_for_type(x509.DNSName):
        raise IdentityError("is an authority's, or its alternative name (SAN) is another than its name (CN)")
    times = (_ns(certificate.not_valid_before_utc), _ns(certificate.not_valid_after_utc))
    may_revoke = any(extension.oid == MAY_REVOKE for extension in certificate.extensions)
    return Peer(name, Role(role), PublicKey(key), certificate.serial_number, *times, der, may_revoke)


def utc(at_ns: int) -> datetime:
    """Convert a time in nanoseconds UTC to the date and time format of certificates, in whole seconds."""
    return datetime.fromtimestamp(at_ns // 1_000_000_000, UTC)


def _ns(at: datetime) -> int:
    return int(at.timestamp()) * 1_000_000_000


def _der(pem: bytes) -> bytes:
    try:
        return _loaded(x509.load_pem_x509_certificate, pem).public_bytes(Encoding.DER)
    except _UNREADABLE as error:
        raise IdentityError(_unread(error)) from None


def _loaded(load: Callable[[bytes], x509.Certificate], data: bytes) -> x509.Certificate:
    """Load a certificate. A serial number that is not positive is refused; the library only warns of it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CryptographyDeprecationWarning)
        certificate = load(data)
        if certificate.serial_number <= 0:
            raise IdentityError(_SERIAL)
    return certificate


def _unread(error: Exception) -> str:
    """Return why a certificate could not be read: newer versions of the library refuse non-positive serial numbers, too."""
    return _SERIAL if "serial number" in str(error) else "is not a certificate"


def _read(file: Path) -> bytes:
    try:
        with file.open("rb") as stream:
            data = stream.read(_MAX_FILE_BYTES + 1)
    except PermissionError as error:
        raise unusable(file, error) from None
    except OSError as error:
        raise IdentityError(f"{file}: {(error.strerror or 'cannot be read').lower()}; {_ISSUE}") from None
    if len(data) > _MAX_FILE_BYTES:
        raise IdentityError(f"{file}: is too large; {_ISSUE}")
    return data


def unusable(path: Path, error: OSError, owned: Path | None = None) -> IdentityError:
    """Make the error for a file or folder that cannot be read or written, with the command that fixes it.

    ``owned``: the path that this user should own; None: the file itself.
    """
    closed = next((one for one in reversed(path.absolute().parents) if one.exists() and not os.access(one, os.X_OK)), None)
    try:
        user = pwd.getpwuid(os.geteuid()).pw_name
    except KeyError:
        user = str(os.geteuid())
    mends: dict[type[OSError], str] = {
        PermissionError: f"run `sudo chown {user} {owned or path}`" if closed is None else f"run `sudo chmod a+x {closed}`",
        FileNotFoundError: f"run `mkdir -p {path.parent}`, or name another place",
        IsADirectoryError: "name a file in it",
    }
    mend = mends.get(type(error), f"see `df {path.parent}`, or name another place")
    return IdentityError(f"{path}: {(error.strerror or str(error)).lower()}; {mend}")


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except PermissionError as error:
        raise unusable(path, error) from None


def _with(file: Path, error: IdentityError, mend: str) -> IdentityError:
    """Return the error with the file's name and the remedy, unless it has them already."""
    text = str(error)
    return error if text.startswith(str(file)) else IdentityError(f"{file}: {text}; {mend}")
