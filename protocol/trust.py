"""From a member's identity on disk to what it signs and verifies with."""

from __future__ import annotations

from cryptography.hazmat.primitives.serialization import Encoding

from protocol.identity import Identity
from protocol.signing import Trust


def trust_of(identity: Identity | None) -> Trust | None:
    """What a member with this identity signs and verifies with; None without one."""
    if identity is None:
        return None
    pem = identity.authority.certificate.public_bytes(Encoding.PEM).decode()
    own = identity.own
    return Trust(own.name, identity.sign, own.der, identity.authority, pem, identity.revoked.serials)
