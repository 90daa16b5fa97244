"""Revocation in flight: an operator takes a member's rights away, and all drones leave the same of its log entries out."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct, field

from protocol.entries import SIGNATURE_BYTES
from protocol.message import DroneMessage, StationMessage
from protocol.units import BootId, Certificate, Count, Identifier, StampNs

MOST_BOOTS = 64  # of a revoked drone, of which anything counts
MOST_HELD = 16  # revocations that a drone keeps and passes on


class Revocation(StationMessage, frozen=True, kw_only=True):
    """An operator's revocation of a member, by its name: of a drone, or of another operator.

    ``last``: by boot of a revoked drone the last sequence number that counts; of boots that are not in it nothing counts.
    Sequence numbers, not times: whoever has a stolen key can sign what stamps it likes. ``until_ns``: end of the member's
    certificates, after which the revocation is void and the name can be used again. ``signature``: of the whole message without
    it, by the key of ``certificate``, which is issued to the station with the right to revoke.
    """

    member: Identifier
    until_ns: StampNs
    last: Annotated[dict[BootId, Count], Meta(max_length=MOST_BOOTS)] = field(default_factory=dict)
    certificate: Certificate
    signature: Annotated[bytes, Meta(max_length=SIGNATURE_BYTES)] = b""

    def counts(self, boot: str) -> int:
        """The last sequence number of a boot that counts; -1: nothing of it does."""
        return self.last.get(boot, -1)

    def covers(self, other: Revocation) -> bool:
        """Whether it leaves out all that another one of the same member does, and for as long."""
        lower = all(last <= other.counts(boot) for boot, last in self.last.items())
        return self.member == other.member and self.until_ns >= other.until_ns and lower


class Obeying(Struct, frozen=True, array_like=True):
    """A revoked drone's word that it obeys, and goes home. Others pass it on, and cannot give it.

    ``signature``: by the key of ``certificate``, the drone's, of the revocation that it obeys: it is worth nothing with another.
    """

    drone: Identifier
    certificate: Certificate
    signature: Annotated[bytes, Meta(max_length=SIGNATURE_BYTES)]


class Revoked(DroneMessage, frozen=True, kw_only=True):
    """All revocations that a drone knows, passed on as they were signed.

    ``obeying``: the word of each revoked drone that is known to obey, and to go home; at most one of each.
    """

    held: Annotated[tuple[Revocation, ...], Meta(max_length=MOST_HELD)]
    obeying: Annotated[tuple[Obeying, ...], Meta(max_length=MOST_HELD)] = ()
