"""The members of a simulated swarm: keys and certificates that follow from the seed, by an authority that follows from it too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from hashlib import blake2b

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import NameOID

from protocol.codec import encode
from protocol.identity import Authority, Peer, Role
from protocol.keys import command_key
from protocol.messages import Action, Command, Ticket
from protocol.signing import Sign, Trust, sign_command

OPERATOR_NAME = "lockstep"
_BEGINS, _ENDS = datetime(2020, 1, 1, tzinfo=UTC), datetime(2070, 1, 1, tzinfo=UTC)
_ISSUER = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "simulated authority")])


class SimulatedAuthority:
    """Issues and verifies the certificates of one swarm; the same ones for the same seed."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._key = _key(seed, "authority")
        self.authority = Authority(self._certificate(_ISSUER, self._key, None))
        self._pem = self.authority.certificate.public_bytes(Encoding.PEM).decode()

    def trust(self, name: str, role: str = Role.DRONE) -> Trust:
        """What a member of that name and role signs and verifies with."""
        key = _key(self._seed, name)
        attributes = ((NameOID.COMMON_NAME, name), (NameOID.ORGANIZATIONAL_UNIT_NAME, role))
        subject = x509.Name([x509.NameAttribute(oid, value) for oid, value in attributes])
        certificate = self._certificate(subject, key, name).public_bytes(Encoding.DER)
        return Trust(name, key.sign, certificate, self.authority, self._pem)

    def signs(self, names: Sequence[str]) -> list[Sign]:
        """What signs as each of these members."""
        return [_key(self._seed, name).sign for name in names]

    def verify(self, der: bytes) -> Peer:
        """As the authority does that the members know."""
        return self.authority.verify(der)

    def _certificate(self, subject: x509.Name, key: Ed25519PrivateKey, name: str | None) -> x509.Certificate:
        """That of a member, or of the authority itself (``name`` None)."""
        public = key.public_key()
        builder = (
            x509.CertificateBuilder(_ISSUER, subject, public, _number(public.public_bytes_raw()))
            .not_valid_before(_BEGINS)
            .not_valid_after(_ENDS)
            .add_extension(x509.BasicConstraints(ca=name is None, path_length=0 if name is None else None), critical=True)
        )
        if name is not None:
            builder = builder.add_extension(x509.SubjectAlternativeName([x509.DNSName(name)]), critical=False)
        return builder.sign(self._key, None)


def operator_of(authority: SimulatedAuthority) -> Trust:
    """Lockstep's operator."""
    return authority.trust(OPERATOR_NAME, Role.OPERATOR)


class SimulatedOperator:
    """Lockstep's operator: hears every status, and its commands reach everybody at once."""

    def __init__(self, authority: SimulatedAuthority, swarm: str, mission: str) -> None:
        self.authority, self._mission = authority, mission
        self._trust = operator_of(authority)
        self.key = command_key(swarm, OPERATOR_NAME)

    def ordered(self, now_ns: int, action: Action, tickets: Mapping[str, Ticket]) -> bytes:
        """A command to the drones of these tickets."""
        command = Command(stamp_ns=now_ns, station=OPERATOR_NAME, mission=self._mission, action=action, to=dict(tickets))
        return encode(sign_command(command, self._trust))


def _key(seed: int, name: str) -> Ed25519PrivateKey:
    return Ed25519PrivateKey.from_private_bytes(blake2b(f"{seed} {name}".encode(), digest_size=32).digest())


def _number(data: bytes) -> int:
    return int.from_bytes(blake2b(data, digest_size=15).digest()) + 1
