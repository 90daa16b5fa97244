"""Signatures of log entries, statuses, commands and revocations (Ed25519, RFC 8032), verified with the members' certificates.

Log entries that are published together have one signature: that of the root of their hash tree (BLAKE2b-128, as in RFC 6962 with
different hashes for leaves and nodes). The proof of an entry is this signature, its place in the tree, and the hashes beside its
way to the root. So each entry can be verified by itself, whoever relays or recovers it, and a batch costs one verification.
"""

from __future__ import annotations

from collections import OrderedDict, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from typing import Protocol, TypeVar

from msgspec import UNSET
from msgspec.structs import replace

from protocol.codec import as_bytes, written
from protocol.entries import SIGNATURE_BYTES, Credential, Entry
from protocol.errors import ProtocolError
from protocol.message import StationMessage
from protocol.messages import Action, Command, Obeyed, Order, Status, Upload
from protocol.revocations import Obeying, Revocation

MOST_IN_BATCH = 32  # of the place in a proof, and of its length
MOST_ROOTS = 1024  # that are remembered as verified
MOST_CERTIFICATES = 256  # that are remembered as read
MOST_OF_BOOT = 4  # certificates; an honest agent has one
DRONE, OPERATOR = "drone", "operator"  # as ``identity.Role``, which the pilot program must not import: it handles dates
_HASH_BYTES = 16
# No signature counts as one of something else.
_ENTRIES, _STATUS, _REVOCATION = b"radron 2 entries\0", b"radron 2 status\0", b"radron 2 revocation\0"
_OBEYED, _OBEYING = b"radron 2 obeyed\0", b"radron 2 obeying\0"
_ORDERS: dict[type[Order], bytes] = {Command: b"radron 2 command\0", Upload: b"radron 2 upload\0"}

Sign = Callable[[bytes], bytes]
Signed = tuple[bytes, bytes]  # a signature, and what it is one of
SignedRoot = Callable[[Entry, bytes], Signed | None]  # as ``signed_root``
E = TypeVar("E", bound=Entry)
S = TypeVar("S", bound=Order)


class Member(Protocol):
    """A verified certificate."""

    @property
    def name(self) -> str:
        """Id of a drone, or name of a station."""
        ...

    @property
    def role(self) -> str:
        """One of ``identity.Role``."""
        ...

    @property
    def may_revoke(self) -> bool:
        """Whether it has the right to revoke others in flight."""
        ...

    @property
    def serial(self) -> int:
        """Number of the certificate."""
        ...

    @property
    def not_before_ns(self) -> int:
        """Beginning of its validity, UTC."""
        ...

    @property
    def not_after_ns(self) -> int:
        """End of its validity, UTC."""
        ...

    def verified(self, signature: bytes, data: bytes) -> bool:
        """Whether this member has signed these bytes."""
        ...


class Authority(Protocol):
    """Whoever issues the certificates of a swarm."""

    def verify(self, der: bytes) -> Member:
        """Read a certificate; raises ProtocolError where this authority has not issued it."""
        ...


@dataclass(frozen=True, slots=True)
class Trust:
    """What a member signs and verifies with: its key, in ``sign``, its own certificate (DER), and the swarm's authority, with its
    own certificate (PEM) for whoever verifies later.
    """

    name: str
    sign: Sign
    certificate: bytes
    authority: Authority
    authority_pem: str = ""
    revoked: frozenset[int] = frozenset()  # serial numbers of certificates that command no more


def sign_command(command: S, trust: Trust) -> S:
    """A command, or another message of a station, with that station's certificate and signature."""
    bare, _ = written(replace(command, certificate=trust.certificate, signature=b""))
    return replace(command, certificate=trust.certificate, signature=trust.sign(_ORDERS[type(command)] + bare))


def sign_status(status: Status, trust: Trust) -> Status:
    """A status, as its receivers read it (``codec.written``), with certificate and signature of its drone."""
    bare = replace(status, certificate=trust.certificate, signature=b"")
    signature = trust.sign(_STATUS + _without_obeyed(bare))
    if bare.obeyed is UNSET:
        return replace(bare, signature=signature)
    obeyed = replace(bare.obeyed, signature=trust.sign(_OBEYED + _with_obeyed(bare, bare.obeyed)))
    return replace(bare, obeyed=obeyed, signature=signature)


def sign_revocation(revocation: Revocation, trust: Trust) -> Revocation:
    """The revocation with certificate and signature of its station."""
    bare, _ = written(replace(revocation, certificate=trust.certificate, signature=b""))
    return replace(revocation, certificate=trust.certificate, signature=trust.sign(_REVOCATION + bare))


def sign_obeying(revocation: Revocation, trust: Trust) -> Obeying:
    """The word of the drone that is revoked that it obeys."""
    return Obeying(trust.name, trust.certificate, trust.sign(_OBEYING + revocation.signature))


def sign_entries(entries: Sequence[E], sign: Sign) -> Iterator[E]:
    """Entries that are published together, with their proofs. Each must be as its receivers read it (``codec.written``)."""
    for start in range(0, len(entries), MOST_IN_BATCH):
        batch = entries[start : start + MOST_IN_BATCH]
        rows = _tree([_leaf(as_bytes(replace(entry, proof=b""))) for entry in batch])
        signature = sign(_ENTRIES + rows[-1][0])
        for place, entry in enumerate(batch):
            beside = [row[place >> level ^ 1] for level, row in enumerate(rows[:-1])]
            yield replace(entry, proof=b"".join((signature, bytes((place,)), *beside)))


def signed_root(entry: Entry, payload: bytes) -> Signed | None:
    """The signature in an entry's proof, and what it must be a signature of; None where the proof is none, or where the entry, as
    it is written, is not its ``payload``.
    """
    if as_bytes(entry) != payload:  # else a relay could add a field that no reader knows
        return None
    way = entry.proof[SIGNATURE_BYTES + 1 :]
    if len(entry.proof) <= SIGNATURE_BYTES or len(way) % _HASH_BYTES or len(way) > 5 * _HASH_BYTES:
        return None
    place, found = entry.proof[SIGNATURE_BYTES], _leaf(as_bytes(replace(entry, proof=b"")))
    for start in range(0, len(way), _HASH_BYTES):
        beside = way[start : start + _HASH_BYTES]
        found = _node(beside, found) if place & 1 else _node(found, beside)
        place >>= 1
    return None if place else (entry.proof[:SIGNATURE_BYTES], _ENTRIES + found)


class Verifier:
    """Tells which entries, statuses, commands and revocations are what their publishers have signed. By their bytes alone: all
    drones judge alike.
    """

    def __init__(
        self, authority: Authority, revoked: frozenset[int] = frozenset(), signed_root: SignedRoot = signed_root
    ) -> None:
        """``revoked``: serial numbers of certificates that command no more; ``signed_root``: as the function, or from memory."""
        self._authority, self._revoked, self._signed_root = authority, revoked, signed_root
        self._revoked_names: set[str] = set()
        self._read: OrderedDict[bytes, Member] = OrderedDict()
        self._boots: defaultdict[tuple[str, str], list[Member]] = defaultdict(list)
        self._roots: OrderedDict[tuple[str, str, bytes, bytes], None] = OrderedDict()

    def knows(self, entry: Entry) -> bool:
        """Whether the certificate that the entry is verified with is known: that of its drone in its boot, or its own."""
        return isinstance(entry, Credential) or (entry.drone, entry.boot) in self._boots

    def accepts_entry(self, entry: Entry, payload: bytes) -> bool:
        """Whether its drone has signed just these bytes. A credential that is accepted counts from then on."""
        signed = self._signed_root(entry, payload)
        if signed is None:
            return False
        boot = entry.drone, entry.boot
        member = self._of_credential(entry) if isinstance(entry, Credential) else None
        if member is None and isinstance(entry, Credential):  # whatever else its drone has signed together with it
            return False
        if (*boot, *signed) in self._roots:
            self._roots.move_to_end((*boot, *signed))
            return True
        members = self._boots.get(boot, ()) if member is None else (member,)
        if not any(one.verified(*signed) for one in members):
            return False
        if member is not None and len(self._boots[boot]) < MOST_OF_BOOT:
            self._boots[boot].append(member)
        self._roots[(*boot, *signed)] = None
        if len(self._roots) > MOST_ROOTS:
            self._roots.popitem(last=False)
        return True

    def accepts_status(self, status: Status) -> bool:
        """Whether its drone has signed a status. The times of its certificate do not matter: a status lasts for seconds."""
        member = self._member(status.certificate)
        if member is None or member.role != DRONE or member.name != status.drone:
            return False
        return member.verified(status.signature, _STATUS + _without_obeyed(status))

    def accepts_obeyed(self, status: Status) -> bool:
        """Whether its drone has signed too which order it has obeyed. For a status that is accepted."""
        member = self._member(status.certificate)
        if member is None or status.obeyed is UNSET:
            return False
        return member.verified(status.obeyed.signature, _OBEYED + _with_obeyed(status, status.obeyed))

    def accepts_obeying(self, word: Obeying, revocation: Revocation) -> bool:
        """Whether the drone that is revoked has signed that it obeys just this revocation, which is accepted."""
        member = self._member(word.certificate)
        if member is None or member.role != DRONE or not word.drone == member.name == revocation.member:
            return False
        return member.verified(word.signature, _OBEYING + revocation.signature)

    def signer(self, order: Order) -> Member | None:
        """Whose certificate an order carries, whether valid or not; None: nobody's of this swarm."""
        return self._member(order.certificate)

    def revoke(self, name: str) -> None:
        """An operator of this name commands no more."""
        self._revoked_names.add(name)

    def refusal(self, command: Order, now_ns: int) -> str | None:
        """Why a command is not what an operator of this swarm has signed; None where it is.

        A certificate's time is judged on the ground only: the clock must not keep anybody from landing the swarm.
        """
        station = self._operator(command, command.certificate)
        if isinstance(station, str):
            return station
        if station.name in self._revoked_names:
            return "with_revoked_certificate"
        if not station.verified(command.signature, _ORDERS[type(command)] + as_bytes(replace(command, signature=b""))):
            return "forged"
        in_flight = isinstance(command, Command) and command.action is not Action.START
        if not in_flight and not station.not_before_ns <= now_ns <= station.not_after_ns:
            return "with_expired_certificate"
        return None

    def revocation_refusal(self, revocation: Revocation, heard_ns: int) -> str | None:
        """Why a revocation is not what an operator with the right to revoke has signed; None where it is.

        Its own stamp decides whether the certificate was valid, and one operator's revocation of another does not undo those of
        the other: the order of arrival must not matter. Whom the authority itself has revoked, revokes nobody. ``heard_ns``: when
        it came from its station: the certificate must not have ended by then either.
        """
        station = self._operator(revocation, revocation.certificate)
        if isinstance(station, str):
            return station
        if not station.may_revoke:
            return "without_the_right"
        if not station.verified(revocation.signature, _REVOCATION + as_bytes(replace(revocation, signature=b""))):
            return "forged"
        if not station.not_before_ns <= revocation.stamp_ns <= max(revocation.stamp_ns, heard_ns) <= station.not_after_ns:
            return "with_expired_certificate"
        return None

    def _operator(self, message: StationMessage, certificate: bytes) -> Member | str:
        """The operator whose message this may be, its signature apart; or why it is none."""
        station = self._member(certificate)
        if station is None or station.name != message.station:
            return "without_valid_certificate"
        if station.serial in self._revoked:
            return "with_revoked_certificate"
        return station if station.role == OPERATOR else f"by_a_{station.role}"

    def _of_credential(self, entry: Credential) -> Member | None:
        """The member of a drone's certificate that was valid when the boot began."""
        member = self._member(entry.certificate)
        if member is None or member.role != DRONE or member.name != entry.drone or entry.sequence != 0:
            return None
        return member if member.not_before_ns <= entry.stamp_ns <= member.not_after_ns else None

    def _member(self, certificate: bytes) -> Member | None:
        known = self._read.get(certificate)
        if known is not None:
            self._read.move_to_end(certificate)
            return known
        try:
            member = self._authority.verify(certificate)
        except ProtocolError:
            return None
        self._read[certificate] = member
        if len(self._read) > MOST_CERTIFICATES:
            self._read.popitem(last=False)
        return member


def _without_obeyed(status: Status) -> bytes:
    """What a status' signature is one of."""
    return as_bytes(replace(status, obeyed=UNSET, signature=b""))


def _with_obeyed(status: Status, obeyed: Obeyed) -> bytes:
    """What the signature of the obeyed order in it is one of."""
    return as_bytes(replace(status, obeyed=replace(obeyed, signature=b""), signature=b""))


def _tree(leaves: list[bytes]) -> list[list[bytes]]:
    """The rows of a hash tree from the leaves to the root; the row of the leaves is filled up with zeros to a power of two."""
    size = 1 << (len(leaves) - 1).bit_length()
    rows = [leaves + [bytes(_HASH_BYTES)] * (size - len(leaves))]
    while len(rows[-1]) > 1:
        row = rows[-1]
        rows.append([_node(row[place], row[place + 1]) for place in range(0, len(row), 2)])
    return rows


def _leaf(body: bytes) -> bytes:
    return blake2b(body, digest_size=_HASH_BYTES, person=b"leaf").digest()


def _node(left: bytes, right: bytes) -> bytes:
    return blake2b(left + right, digest_size=_HASH_BYTES, person=b"node").digest()
