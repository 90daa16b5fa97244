"""Signatures of log entries, statuses, commands and revocations (Ed25519, RFC 8032), verified with the members' certificates.

Log entries published together have one signature, of the root of their hash tree (BLAKE2b-128, as in RFC 6962 with different
hashes for leaves and nodes). The proof of an entry is this signature, its place in the tree, and the hashes beside its path to
the root. Each entry can therefore be verified by itself, over any relay or recovery, and a batch costs one verification.
"""

from __future__ import annotations

from collections import OrderedDict, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from typing import Protocol, TypeVar

from msgspec import UNSET, UnsetType
from msgspec.structs import replace

from radron.protocol.codec import as_bytes, written
from radron.protocol.entries import SIGNATURE_BYTES, Credential, Entry
from radron.protocol.errors import ProtocolError
from radron.protocol.message import StationMessage
from radron.protocol.messages import Action, Command, Obeyed, Order, Status, Upload
from radron.protocol.revocations import Obeying, Revocation

MAX_BATCH_ENTRIES = 32  # entries; limits the place in a proof, and the proof's length
MAX_VERIFIED_ROOTS = 1024  # kept as verified
MAX_READ_CERTIFICATES = 256  # kept as read
MAX_BOOT_CERTIFICATES = 4  # certificates; an honest agent has one
DRONE, OPERATOR = "drone", "operator"  # as ``identity.Role``, which the pilot program must not import: it handles dates
_HASH_BYTES = 16
# Signed prefixes: a signature of one kind of message is invalid for every other kind.
_ENTRIES, _STATUS, _REVOCATION = b"radron 2 entries\0", b"radron 2 status\0", b"radron 2 revocation\0"
_OBEYED, _OBEYING = b"radron 2 obeyed\0", b"radron 2 obeying\0"
_ORDERS: dict[type[Order], bytes] = {Command: b"radron 2 command\0", Upload: b"radron 2 upload\0"}

Sign = Callable[[bytes], bytes]
Signed = tuple[bytes, bytes]  # a signature, and the signed bytes
SignedRoot = Callable[[Entry, bytes], Signed | None]  # as ``signed_root``
E = TypeVar("E", bound=Entry)
S = TypeVar("S", bound=Order)


class Member(Protocol):
    """A member of the swarm (drone or operator) whose certificate has been verified.

    This protocol keeps ``identity.Peer`` out of this module, since programs that import this module must not handle dates.
    """

    @property
    def name(self) -> str:
        """Id of the drone, or name of the operator's station."""
        ...

    @property
    def role(self) -> str:
        """The member's role, one of the values of ``identity.Role``."""
        ...

    @property
    def may_revoke(self) -> bool:
        """Whether this operator may withdraw the rights of other members in flight."""
        ...

    @property
    def serial(self) -> int:
        """Serial number of the member's certificate."""
        ...

    @property
    def not_before_ns(self) -> int:
        """Beginning of the certificate's validity, in nanoseconds UTC."""
        ...

    @property
    def not_after_ns(self) -> int:
        """End of the certificate's validity, in nanoseconds UTC."""
        ...

    def verified(self, signature: bytes, data: bytes) -> bool:
        """Return whether ``signature`` is this member's signature of ``data``."""
        ...


class Authority(Protocol):
    """The authority that issues the certificates of a swarm."""

    def verify(self, der: bytes) -> Member:
        """Read a certificate (DER) and return its member.

        Raises ProtocolError if this authority has not issued the certificate.
        """
        ...


@dataclass(frozen=True, slots=True)
class Trust:
    """The keys with which a member signs its own messages and verifies the messages of other members.

    ``sign``: signs bytes with the member's private key. ``certificate``: the member's own certificate (DER). ``authority``:
    verifies the certificates of the swarm; ``authority_pem`` is the authority's own certificate, kept so that records of a flight
    can be verified later.
    """

    name: str
    sign: Sign
    certificate: bytes
    authority: Authority
    authority_pem: str = ""
    revoked: frozenset[int] = frozenset()  # serial numbers of certificates without a right to command any more


def sign_command(command: S, trust: Trust) -> S:
    """Sign an operator's order (command or upload), and return it with the signature and the station's certificate."""
    bare, _ = written(replace(command, certificate=trust.certificate, signature=b""))
    return replace(command, certificate=trust.certificate, signature=trust.sign(_ORDERS[type(command)] + bare))


def sign_status(status: Status, trust: Trust) -> Status:
    """Sign a drone's status, and return it with the signature and the drone's certificate.

    The status must be as its receivers decode it (second result of ``codec.written``).
    """
    bare = replace(status, certificate=trust.certificate, signature=b"")
    signature, obeyed = trust.sign(_STATUS + _core(bare)), bare.obeyed
    if obeyed is not UNSET:
        obeyed = replace(obeyed, signature=trust.sign(_OBEYED + _core(bare, obeyed=obeyed)))
    return replace(bare, obeyed=obeyed, signature=signature)


def sign_revocation(revocation: Revocation, trust: Trust) -> Revocation:
    """Sign an operator's revocation of a member, and return it with the signature and the station's certificate."""
    bare, _ = written(replace(revocation, certificate=trust.certificate, signature=b""))
    return replace(revocation, certificate=trust.certificate, signature=trust.sign(_REVOCATION + bare))


def sign_obeying(revocation: Revocation, trust: Trust) -> Obeying:
    """Return a signed statement of a revoked drone that it obeys this revocation and returns."""
    return Obeying(trust.name, trust.certificate, trust.sign(_OBEYING + revocation.signature))


def sign_entries(entries: Sequence[E], sign: Sign) -> Iterator[E]:
    """Sign log entries that are published together, and yield each with its proof.

    A proof lets a receiver verify the entry without the others of its batch. Each entry must be as its receivers decode it
    (second result of ``codec.written``).
    """
    for start in range(0, len(entries), MAX_BATCH_ENTRIES):
        batch = entries[start : start + MAX_BATCH_ENTRIES]
        rows = _tree([_leaf(as_bytes(replace(entry, proof=b""))) for entry in batch])
        signature = sign(_ENTRIES + rows[-1][0])
        for place, entry in enumerate(batch):
            beside = [row[place >> level ^ 1] for level, row in enumerate(rows[:-1])]
            yield replace(entry, proof=b"".join((signature, bytes((place,)), *beside)))


def signed_root(entry: Entry, payload: bytes) -> Signed | None:
    """Return the signature in the proof of a log entry, and the bytes that were signed (the root of the batch's hash tree).

    Return None for a malformed proof, or if the encoded entry differs from the received ``payload``.
    """
    if as_bytes(entry) != payload:  # else a relay could add an unknown field
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
    """Verifies the signatures of log entries, statuses, commands and revocations.

    The result depends on the messages' bytes, not on the time of verification, so that all drones come to the same result. Only
    the validity of an operator's certificate also depends on the time at which an order arrives.
    """

    def __init__(
        self, authority: Authority, revoked: frozenset[int] = frozenset(), signed_root: SignedRoot = signed_root
    ) -> None:
        """``revoked``: serial numbers of certificates that have lost the right to command. ``signed_root``: the function of this
        module, or a cached version.
        """
        self._authority, self._revoked, self._signed_root = authority, revoked, signed_root
        self._revoked_names: set[str] = set()
        self._read: OrderedDict[bytes, Member] = OrderedDict()
        self._boots: defaultdict[tuple[str, str], list[Member]] = defaultdict(list)
        self._roots: OrderedDict[tuple[str, str, bytes, bytes], None] = OrderedDict()

    def knows(self, entry: Entry) -> bool:
        """Return whether the certificate that verifies this log entry has been received.

        It is the certificate that the drone has published in this boot (run of its agent); a credential contains its own
        certificate.
        """
        return isinstance(entry, Credential) or (entry.drone, entry.boot) in self._boots

    def accepts_entry(self, entry: Entry, payload: bytes) -> bool:
        """Return whether a log entry is signed by its drone, exactly with these bytes.

        An accepted credential (a drone's certificate) is used to verify later entries of its boot.
        """
        signed = self._signed_root(entry, payload)
        if signed is None:
            return False
        boot = entry.drone, entry.boot
        member = self._of_credential(entry) if isinstance(entry, Credential) else None
        if member is None and isinstance(entry, Credential):  # even if its drone has signed other entries together with it
            return False
        if (*boot, *signed) in self._roots:
            self._roots.move_to_end((*boot, *signed))
            return True
        members = self._boots.get(boot, ()) if member is None else (member,)
        if not any(one.verified(*signed) for one in members):
            return False
        if member is not None and len(self._boots[boot]) < MAX_BOOT_CERTIFICATES:
            self._boots[boot].append(member)
        self._roots[(*boot, *signed)] = None
        if len(self._roots) > MAX_VERIFIED_ROOTS:
            self._roots.popitem(last=False)
        return True

    def accepts_status(self, status: Status) -> bool:
        """Return whether a status is signed by the drone that it names.

        The certificate's period of validity is not checked, as a status is used for seconds only.
        """
        member = self._member(status.certificate)
        if member is None or member.role != DRONE or member.name != status.drone:
            return False
        return member.verified(status.signature, _STATUS + _core(status))

    def accepts_obeyed(self, status: Status) -> bool:
        """Return whether the drone has signed the record of its last executed order, in a status that has been accepted."""
        member = self._member(status.certificate)
        if member is None or status.obeyed is UNSET:
            return False
        return member.verified(status.obeyed.signature, _OBEYED + _core(status, obeyed=status.obeyed))

    def accepts_obeying(self, word: Obeying, revocation: Revocation) -> bool:
        """Return whether the revoked drone has signed that it obeys exactly this revocation."""
        member = self._member(word.certificate)
        if member is None or member.role != DRONE or not word.drone == member.name == revocation.member:
            return False
        return member.verified(word.signature, _OBEYING + revocation.signature)

    def signer(self, order: Order) -> Member | None:
        """Return the member that has signed an order, according to its certificate, even if expired.

        Return None if no authority of this swarm has issued the certificate.
        """
        return self._member(order.certificate)

    def revoke(self, name: str) -> None:
        """Refuse all further commands of operators with this name."""
        self._revoked_names.add(name)

    def refusal(self, command: Order, now_ns: int) -> str | None:
        """Return the reason why an operator's command must not be executed; None if its signature and certificate are good.

        The certificate's period of validity counts on the ground only: a wrong clock must not prevent a landing of the swarm.
        ``now_ns``: this drone's time, nanoseconds UTC.
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
        """Return the reason why a revocation (withdrawal of a member's rights) must not be obeyed; None if it is good.

        It must be signed by an operator with the right to revoke. The stamp of the revocation decides whether the certificate was
        valid, and revoking an operator does not undo that operator's revocations: the order of arrival must not matter. An
        operator revoked by the authority itself cannot revoke. ``heard_ns``: time of arrival from the operator's station,
        nanoseconds UTC; the certificate must not have expired by then, either.
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
        """Return the operator of a message, before the check of its signature; or why there is no such operator."""
        station = self._member(certificate)
        if station is None or station.name != message.station:
            return "without_valid_certificate"
        if station.serial in self._revoked:
            return "with_revoked_certificate"
        return station if station.role == OPERATOR else f"by_a_{station.role}"

    def _of_credential(self, entry: Credential) -> Member | None:
        """Return the member of a drone's certificate; None unless the certificate was valid at the beginning of the boot."""
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
        if len(self._read) > MAX_READ_CERTIFICATES:
            self._read.popitem(last=False)
        return member


def _core(status: Status, *, obeyed: Obeyed | UnsetType = UNSET) -> bytes:
    """Return the bytes of a status that its signature covers; with ``obeyed``, those that the signature of ``obeyed`` covers."""
    if obeyed is not UNSET:
        obeyed = replace(obeyed, signature=b"")
    return as_bytes(replace(status, obeyed=obeyed, signature=b""))


def _tree(leaves: list[bytes]) -> list[list[bytes]]:
    """Return the rows of a hash tree from the leaves to the root; zeros fill the row of leaves up to a power of two."""
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
