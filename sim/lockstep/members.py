"""Members of a simulated swarm: their keys, certificates and authority are derived from the seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from hashlib import blake2b

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding

from radron.protocol.codec import encode
from radron.protocol.ed25519 import Signer
from radron.protocol.identity import Peer, Role
from radron.protocol.issuing import Issuer
from radron.protocol.keys import command_key, key_of
from radron.protocol.messages import Action, Command, Ticket
from radron.protocol.revocations import Revocation, Revoked
from radron.protocol.signing import Sign, Trust, sign_command, sign_revocation
from radron.sim.lockstep.sharing import Results

OPERATOR_NAME = "lockstep"
MAX_SIGNED = 512  # remembered signatures: all drones verify them within the delay of the radio
_BEGINS_NS, _DAYS = 1_577_836_800_000_000_000, 18_263  # 2020 to 2070


@dataclass(frozen=True, slots=True)
class KnownPeer(Peer):
    """A member of a simulated swarm; each of its signatures is verified only once for all drones, to save time."""

    known: Results = field(kw_only=True, repr=False, compare=False)

    def verified(self, signature: bytes, data: bytes) -> bool:
        """Return whether ``signature`` is this member's signature of ``data``."""
        return self.known.get((self.der, signature, data), partial(Peer.verified, self, signature, data))


class SimulatedAuthority:
    """Certificate authority of a simulated swarm; equal seeds give equal certificates."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._issuer = Issuer.new("simulated", _BEGINS_NS, _DAYS, _key(seed, "authority"))
        self.authority = self._issuer.authority
        self._known = Results(MAX_SIGNED)
        self._pem = self.authority.certificate.public_bytes(Encoding.PEM).decode()

    def trust(self, name: str, role: str = Role.DRONE, may_revoke: bool = False) -> Trust:
        """Return the keys and the certificate of a member with this name and role.

        ``may_revoke``: with the right to revoke other members.
        """
        issued = self._issuer.issue(name, Role(role), _BEGINS_NS, _DAYS, may_revoke, _key(self._seed, name))
        return Trust(name, Signer(issued.key), issued.peer.der, self, self._pem)

    def signs(self, names: Sequence[str]) -> list[Sign]:
        """Return the signing function of each of these members."""
        return [Signer(_key(self._seed, name)) for name in names]

    def verify(self, der: bytes) -> KnownPeer:
        """Verify a certificate (DER) as the authority of a real swarm does, and return its member."""
        peer = self.authority.verify(der)
        return KnownPeer(**{one.name: getattr(peer, one.name) for one in fields(peer)}, known=self._known)


def operator_of(authority: SimulatedAuthority) -> Trust:
    """Return the keys of the simulated operator, who has the right to revoke members."""
    return authority.trust(OPERATOR_NAME, Role.OPERATOR, may_revoke=True)


class SimulatedOperator:
    """The operator of a simulated flight, who receives every status and whose commands arrive at once."""

    def __init__(self, authority: SimulatedAuthority, swarm: str, mission: str) -> None:
        self.authority, self._swarm, self._mission = authority, swarm, mission
        self._trust = operator_of(authority)
        self.key = command_key(swarm, OPERATOR_NAME)

    def ordered(self, now_ns: int, action: Action, tickets: Mapping[str, Ticket]) -> bytes:
        """Return a signed command to drones, as bytes.

        ``tickets``: the newest ticket of each addressed drone (proof of freshness).
        """
        command = Command(stamp_ns=now_ns, station=OPERATOR_NAME, mission=self._mission, action=action, to=dict(tickets))
        return encode(sign_command(command, self._trust))

    def revoked(self, now_ns: int, member: str, last: Mapping[str, int]) -> tuple[str, bytes]:
        """Return key and payload of a revocation of a member, valid for a day.

        ``last``: by boot (run of the agent), the sequence number of the last log entry that counts.
        """
        until_ns = now_ns + 86_400_000_000_000
        bare = Revocation(
            stamp_ns=now_ns, station=OPERATOR_NAME, member=member, until_ns=until_ns, last=dict(last), certificate=b""
        )
        return key_of(self._swarm, bare), encode(sign_revocation(bare, self._trust))

    def kept(self, drone: str, held: tuple[Revocation, ...], now_ns: int) -> tuple[str, bytes]:
        """Return key and payload of a message with the revocations saved on a drone's disk."""
        message = Revoked(stamp_ns=now_ns, drone=drone, held=held)
        return key_of(self._swarm, message), encode(message)


def nonce_key_of(seed: int, drone: str, starts: int) -> bytes:
    """Return the key from which a drone's agent derives its random words for tickets, after this number of earlier starts."""
    return blake2b(f"{seed} {drone} nonces {starts}".encode(), digest_size=16).digest()


def _key(seed: int, name: str) -> Ed25519PrivateKey:
    return Ed25519PrivateKey.from_private_bytes(blake2b(f"{seed} {name}".encode(), digest_size=32).digest())
