"""Issue of certificates by the swarm's authority, and the folders in which the members keep them."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import timedelta
from hashlib import blake2b
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from radron.protocol.identity import (
    AUTHORITY_FILE,
    CERTIFICATE_FILE,
    KEY_FILE,
    MAY_REVOKE,
    REVOKED_FILE,
    REVOKED_NAME,
    Authority,
    Peer,
    Role,
    checked_name,
    utc,
)

AUTHORITY_DAYS = 3650
DAYS = {Role.DRONE: 30, Role.OPERATOR: 90, Role.OBSERVER: 90, Role.STATION: 365, Role.RELEASE: 365}
EARLIER = timedelta(hours=1)  # certificates begin this much in the past: a drone's clock may be behind
_LIST_DAYS = 3650  # until a list of revoked certificates should be replaced; members accept older lists, too
_THROWAWAY_DAYS = 31  # so that no agent reminds of their end
_NULL = b"\x05\x00"  # DER: the presence of the extension is its content


@dataclass(frozen=True, slots=True)
class Credentials:
    """A newly issued certificate of a member, with its private key."""

    peer: Peer
    key: Ed25519PrivateKey = field(repr=False)


@dataclass(frozen=True, slots=True)
class Issuer:
    """The certificate authority of a swarm, with the private key with which it signs the members' certificates."""

    authority: Authority
    key: Ed25519PrivateKey = field(repr=False)

    @classmethod
    def new(cls, swarm: str, now_ns: int, days: int = AUTHORITY_DAYS, key: Ed25519PrivateKey | None = None) -> Issuer:
        """Create a certificate authority for a ``swarm``, with a self-signed certificate valid for ``days``.

        ``now_ns``: beginning of the validity, nanoseconds UTC. ``key``: private key of the authority; None: generate a new key.

        Raises:
            IdentityError: the swarm's name is not allowed.
        """
        key = key or Ed25519PrivateKey.generate()
        name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"{checked_name(swarm)} authority")])
        usage = x509.KeyUsage(False, False, False, False, False, True, True, False, False)  # signs certificates and lists
        certificate = (
            x509.CertificateBuilder(name, name, key.public_key(), _serial(key))
            .not_valid_before(utc(now_ns) - EARLIER)
            .not_valid_after(utc(now_ns) + timedelta(days=days))
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(usage, critical=True)
            .sign(key, None)
        )
        return cls(Authority(certificate), key)

    def issue(
        self,
        name: str,
        role: Role,
        now_ns: int,
        days: float | None = None,
        may_revoke: bool = False,
        key: Ed25519PrivateKey | None = None,
    ) -> Credentials:
        """Issue a certificate to a member of the swarm, and return it with the member's private key.

        ``days``: period of validity, which ends with the authority's own validity at the latest; None: the usual period of the
        role (``DAYS``). ``may_revoke``: the right to revoke other members in flight, effective for operators only. ``key``: the
        member's private key; None: generate a new key.

        Raises:
            IdentityError: the member's name is not allowed.
        """
        key = key or Ed25519PrivateKey.generate()
        attributes = ((NameOID.COMMON_NAME, checked_name(name)), (NameOID.ORGANIZATIONAL_UNIT_NAME, str(role)))
        subject = x509.Name([x509.NameAttribute(oid, value) for oid, value in attributes])
        issuer = self.authority.certificate
        ends = utc(now_ns) + timedelta(days=DAYS[role] if days is None else days)
        builder = (
            x509.CertificateBuilder(issuer.subject, subject, key.public_key(), _serial(key))
            .not_valid_before(utc(now_ns) - EARLIER)
            .not_valid_after(min(ends, issuer.not_valid_after_utc))
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(x509.SubjectAlternativeName([x509.DNSName(name)]), critical=False)
            .add_extension(
                x509.ExtendedKeyUsage([ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]), critical=False
            )
        )
        if may_revoke:
            builder = builder.add_extension(x509.UnrecognizedExtension(MAY_REVOKE, _NULL), critical=False)
        certificate = builder.sign(self.key, None)
        return Credentials(self.authority.verify(certificate.public_bytes(Encoding.DER)), key)

    def revocation_list(self, revoked: Mapping[int, str], now_ns: int) -> bytes:
        """Sign a list of revoked certificates (CRL) and return it in PEM format.

        ``revoked``: from the serial number of a certificate to the member's name; an empty name may be used again by another
        member.
        """
        builder = x509.CertificateRevocationListBuilder(
            self.authority.certificate.subject, utc(now_ns), utc(now_ns) + timedelta(days=_LIST_DAYS)
        )
        for serial, name in revoked.items():
            entry = x509.RevokedCertificateBuilder(serial, utc(now_ns))
            if name:
                whose = x509.UnrecognizedExtension(REVOKED_NAME, name.encode("ascii"))
                entry = entry.add_extension(whose, critical=False)
            builder = builder.add_revoked_certificate(entry.build())
        return builder.sign(self.key, None).public_bytes(Encoding.PEM)


def _serial(key: Ed25519PrivateKey) -> int:
    """Return a serial number derived from the certificate's key: positive, and as unpredictable as the key (RFC 5280)."""
    return int.from_bytes(blake2b(key.public_key().public_bytes_raw(), digest_size=15).digest()) + 1


def write_identity(folder: Path, authority: Authority, credentials: Credentials, revoked: bytes | None = None) -> None:
    """Write a member's certificate, private key and authority to a folder; other users cannot read the private key.

    ``revoked``: list of revoked certificates (PEM) to be added; None: no list.

    Raises:
        OSError: the folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    certificate = x509.load_der_x509_certificate(credentials.peer.der)
    pem = credentials.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    write_file(folder / KEY_FILE, pem, secret=True)
    write_file(folder / CERTIFICATE_FILE, certificate.public_bytes(Encoding.PEM))
    write_file(folder / AUTHORITY_FILE, authority.certificate.public_bytes(Encoding.PEM))
    if revoked is not None:
        write_file(folder / REVOKED_FILE, revoked)


def write_file(file: Path, data: bytes, secret: bool = False) -> None:
    """Write a file completely or not at all.

    ``secret``: other users of the computer cannot read the file at any moment.
    """
    descriptor, temporary = tempfile.mkstemp(dir=file.parent, prefix=f".{file.name}-")  # mode 600
    try:
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
            if not secret:
                os.fchmod(descriptor, 0o644)
        os.replace(temporary, file)
    except BaseException:
        os.unlink(temporary)
        raise


def throwaway(members: Mapping[Path, tuple[str, Role]], now_ns: int) -> None:
    """Create an authority for a single flight, and write the folders of all its ``members``.

    The authority's private key is discarded, so that no other member can ever join. ``members``: from a folder to the name and
    role of the member; operators may revoke.

    Raises:
        IdentityError: a name is not allowed.
        OSError: a folder cannot be written.
    """
    issuer = Issuer.new("throwaway", now_ns, _THROWAWAY_DAYS)
    for folder, (name, role) in members.items():
        credentials = issuer.issue(name, role, now_ns, _THROWAWAY_DAYS, may_revoke=role is Role.OPERATOR)
        write_identity(folder, issuer.authority, credentials)
