"""Conversion of a member's identity on disk to its keys for signatures and verification."""

from __future__ import annotations

from cryptography.hazmat.primitives.serialization import Encoding

from radron.protocol.identity import Identity
from radron.protocol.signing import Trust


def trust_of(identity: Identity | None) -> Trust | None:
    """Return the keys with which a member with this identity signs and verifies messages; None without an identity."""
    if identity is None:
        return None
    pem = identity.authority.certificate.public_bytes(Encoding.PEM).decode()
    own = identity.own
    return Trust(own.name, identity.sign, own.der, identity.authority, pem, identity.revoked.serials)
