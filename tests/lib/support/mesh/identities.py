"""Certificates for tests: good ones, and ones that are wrong in a single respect."""

from __future__ import annotations

import time
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, load_pem_private_key
from cryptography.x509.oid import NameOID

from radron.protocol.identity import KEY_FILE, Identity, Role, load_identity, utc
from radron.protocol.issuing import Issuer, write_identity

DAY_NS = 86_400_000_000_000


def now_ns() -> int:
    return time.time_ns()


def new_issuer(swarm: str = "s") -> Issuer:
    return Issuer.new(swarm, now_ns())


def identity(issuer: Issuer, folder: Path, name: str, role: Role = Role.DRONE, from_ns: int = 0, days: int = 30) -> Identity:
    """An identity on disk; ``from_ns``: from when it is valid, relative to now."""
    write_identity(folder / name, issuer.authority, issuer.issue(name, role, now_ns() + from_ns, days))
    return load_identity(folder / name)


def private_key(folder: Path) -> bytes:
    """The 32 bytes of an identity's key."""
    key = load_pem_private_key((folder / KEY_FILE).read_bytes(), password=None)
    assert isinstance(key, Ed25519PrivateKey)
    return key.private_bytes_raw()


@dataclass(frozen=True)
class Wrong:
    """Faults of a certificate; every default is right."""

    names: tuple[str, ...] = ("d1",)
    roles: tuple[str, ...] = ("drone",)
    alternative: str | None = "d1"
    is_authority: bool = False
    curve: bool = False  # a key for ECDSA instead of Ed25519
    self_signed: bool = False
    padding: int = 0


def certificate(issuer: Issuer, wrong: Wrong) -> tuple[bytes, bytes]:
    """Certificate (DER) and key (PEM)."""
    key = ec.generate_private_key(ec.SECP256R1()) if wrong.curve else Ed25519PrivateKey.generate()
    attributes = [(NameOID.COMMON_NAME, name) for name in wrong.names]
    attributes += [(NameOID.ORGANIZATIONAL_UNIT_NAME, role) for role in wrong.roles]
    subject = x509.Name([x509.NameAttribute(oid, value) for oid, value in attributes])
    now = utc(now_ns())
    builder = x509.CertificateBuilder(
        subject if wrong.self_signed else issuer.authority.certificate.subject, subject, key.public_key(), 7
    )
    builder = builder.not_valid_before(now - timedelta(hours=1)).not_valid_after(now + timedelta(days=1))
    builder = builder.add_extension(x509.BasicConstraints(ca=wrong.is_authority, path_length=None), critical=True)
    if wrong.alternative is not None:
        builder = builder.add_extension(x509.SubjectAlternativeName([x509.DNSName(wrong.alternative)]), critical=False)
    if wrong.padding:
        extra = x509.UnrecognizedExtension(x509.ObjectIdentifier("1.2.3.4"), b"x" * wrong.padding)
        builder = builder.add_extension(extra, critical=False)
    if not wrong.self_signed:
        signed = builder.sign(issuer.key, None)
    elif isinstance(key, Ed25519PrivateKey):
        signed = builder.sign(key, None)
    else:
        signed = builder.sign(key, hashes.SHA256())
    return signed.public_bytes(Encoding.DER), key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())


def write_wrong(issuer: Issuer, folder: Path, wrong: Wrong) -> Path:
    """A folder like an identity's, for a certificate that ``load_identity`` refuses."""
    der, key = certificate(issuer, wrong)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "ca.pem").write_bytes(issuer.authority.certificate.public_bytes(Encoding.PEM))
    (folder / "certificate.pem").write_bytes(x509.load_der_x509_certificate(der).public_bytes(Encoding.PEM))
    (folder / "key.pem").write_bytes(key)
    (folder / "key.pem").chmod(0o600)
    return folder
