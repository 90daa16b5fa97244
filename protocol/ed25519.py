"""Ed25519 signatures (RFC 8032), made and verified by libsodium.

Reason: libsodium verifies in half the time of the certificates' library, and lets other threads run meanwhile. In a swarm all
drones verify every batch of log entries at once. Both libraries give the same result, with one exception: libsodium also refuses
keys of small order and signatures with a zero nonce. Only the holder of a key can make these, and they keep no secret.
"""

from __future__ import annotations

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from nacl.exceptions import BadSignatureError
from nacl.signing import SigningKey, VerifyKey

from radron.protocol.entries import SIGNATURE_BYTES


class Signer:
    """Signs bytes with a private Ed25519 key that cannot be read back from this object."""

    __slots__ = ("_key",)

    def __init__(self, key: Ed25519PrivateKey) -> None:
        self._key = SigningKey(key.private_bytes_raw())

    def __call__(self, data: bytes) -> bytes:
        """Return the signature of the data, 64 bytes."""
        return self._key.sign(data).signature


class PublicKey:
    """A public Ed25519 key, which verifies the signatures made with the matching private key."""

    __slots__ = ("_key",)

    def __init__(self, key: Ed25519PublicKey) -> None:
        self._key = VerifyKey(key.public_bytes_raw())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PublicKey) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    def verified(self, signature: bytes, data: bytes) -> bool:
        """Return whether ``signature`` was made over ``data`` with the matching private key."""
        if len(signature) != SIGNATURE_BYTES:
            return False
        try:
            self._key.verify(data, signature)
        except BadSignatureError:
            return False
        return True
