"""Certificates with which releases of the onboard system are signed.

The keys are ECDSA P-256: RAUC (the updater) uses CMS signatures, for which OpenSSL 3.0, the version of Debian and of the drones,
lacks Ed25519. Their only purpose is code signing: they open no links, and the members' certificates, issued for links, sign no
releases.
"""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from radron.deploy.pki.issued import Issued
from radron.protocol.identity import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE, Role, checked_name, utc
from radron.protocol.issuing import DAYS, EARLIER, Issuer, write_file


def issue_release(issuer: Issuer, name: str, now_ns: int, days: int | None, out: Path) -> Issued:
    """Issue a certificate with a new key for signing releases, and write its folder; other users cannot read the key.

    ``days``: period of validity; None: the usual period.

    Raises:
        IdentityError: an invalid name.
        OSError: the folder cannot be written.
    """
    key = ec.generate_private_key(ec.SECP256R1())
    authority = issuer.authority.certificate
    attributes = ((NameOID.COMMON_NAME, checked_name(name)), (NameOID.ORGANIZATIONAL_UNIT_NAME, str(Role.RELEASE)))
    ends = utc(now_ns) + timedelta(days=DAYS[Role.RELEASE] if days is None else days)
    usage = x509.KeyUsage(True, False, False, False, False, False, False, False, False)  # digital signatures
    certificate = (
        x509.CertificateBuilder(authority.subject, x509.Name([x509.NameAttribute(*one) for one in attributes]), key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(utc(now_ns) - EARLIER)
        .not_valid_after(min(ends, authority.not_valid_after_utc))
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(usage, critical=True)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.CODE_SIGNING]), critical=True)
        .sign(issuer.key, None)
    )
    out.mkdir(parents=True, exist_ok=True)
    write_file(out / KEY_FILE, key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()), secret=True)
    write_file(out / CERTIFICATE_FILE, certificate.public_bytes(Encoding.PEM))
    write_file(out / AUTHORITY_FILE, authority.public_bytes(Encoding.PEM))
    return Issued(
        name=name,
        role=Role.RELEASE,
        serial=f"{certificate.serial_number:x}",
        not_before_ns=int(certificate.not_valid_before_utc.timestamp()) * 1_000_000_000,
        not_after_ns=int(certificate.not_valid_after_utc.timestamp()) * 1_000_000_000,
    )
