"""The members of a simulated swarm: keys and certificates that follow from the seed, by an authority that follows from it too.

Lockstep's certificates are not X.509: what is signed and verified with them is the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import blake2b

import msgpack
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from protocol.entries import SIGNATURE_BYTES
from protocol.errors import ProtocolError
from protocol.identity import Role
from protocol.signing import Trust

OPERATOR_NAME = "lockstep"


@dataclass(frozen=True)
class SimulatedMember:
    """A member that is certified for ever."""

    name: str
    role: str
    key: Ed25519PublicKey
    serial: int = 0
    not_before_ns: int = 0
    not_after_ns: int = 2**63 - 1

    def verified(self, signature: bytes, data: bytes) -> bool:
        """Whether this member has signed the data."""
        return _is_signed(self.key, signature, data)


class SimulatedAuthority:
    """Issues and verifies the certificates of one swarm."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._key = _key(seed, "authority")

    def trust(self, name: str, role: str = Role.DRONE) -> Trust:
        """What a member of that name and role signs and verifies with."""
        key = _key(self._seed, name)
        return Trust(name, key.sign, self.certificate(name, role, key.public_key()), self)

    def certificate(self, name: str, role: str, key: Ed25519PublicKey) -> bytes:
        """The certificate of a member's key."""
        body: bytes = msgpack.packb((name, role, key.public_bytes_raw()))
        return self._key.sign(body) + body

    def verify(self, der: bytes) -> SimulatedMember:
        """Read a certificate. Raises ProtocolError where this authority has not issued it."""
        signature, body = der[:SIGNATURE_BYTES], der[SIGNATURE_BYTES:]
        if not _is_signed(self._key.public_key(), signature, body):
            raise ProtocolError("not a certificate of this swarm")
        name, role, raw = msgpack.unpackb(body)
        return SimulatedMember(name, role, Ed25519PublicKey.from_public_bytes(raw))


def operator_of(authority: SimulatedAuthority) -> Trust:
    """Lockstep's operator."""
    return authority.trust(OPERATOR_NAME, Role.OPERATOR)


def _key(seed: int, name: str) -> Ed25519PrivateKey:
    return Ed25519PrivateKey.from_private_bytes(blake2b(f"{seed} {name}".encode(), digest_size=32).digest())


def _is_signed(key: Ed25519PublicKey, signature: bytes, data: bytes) -> bool:
    try:
        key.verify(signature, data)
    except InvalidSignature:
        return False
    return True
