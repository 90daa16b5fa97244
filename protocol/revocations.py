"""Revocation in flight: an operator withdraws a member's rights, and all drones exclude the same of its log entries."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct, field

from protocol.entries import SIGNATURE_BYTES
from protocol.message import DroneMessage, StationMessage
from protocol.units import BootId, Certificate, Count, Identifier, StampNs

MOST_BOOTS = 64  # of a revoked drone, with valid entries
MOST_HELD = 16  # revocations that a drone keeps and relays


class Revocation(StationMessage, frozen=True, kw_only=True):
    """An operator's revocation of a member, by its name: of a drone, or of another operator.

    ``last``: by boot of a revoked drone, the last sequence number that counts; entries of boots not listed here do not count.
    Sequence numbers, not times: the holder of a stolen key can sign any stamps. ``until_ns``: end of the member's certificates,
    after which the revocation is void and the name can be used again. ``signature``: of the message without its signature, by
    the key of ``certificate``, which is issued to the station with the right to revoke.
    """

    member: Identifier
    until_ns: StampNs
    last: Annotated[dict[BootId, Count], Meta(max_length=MOST_BOOTS)] = field(default_factory=dict)
    certificate: Certificate
    signature: Annotated[bytes, Meta(max_length=SIGNATURE_BYTES)] = b""

    def counts(self, boot: str) -> int:
        """Return the last sequence number of a boot that counts; -1: no entry of this boot counts."""
        return self.last.get(boot, -1)

    def covers(self, other: Revocation) -> bool:
        """Whether this revocation excludes all entries that another revocation of the same member excludes, and for as long."""
        lower = all(last <= other.counts(boot) for boot, last in self.last.items())
        return self.member == other.member and self.until_ns >= other.until_ns and lower


class Obeying(Struct, frozen=True, array_like=True):
    """A revoked drone's confirmation that it obeys and returns. Other drones relay the confirmation, and cannot make it.

    ``signature``: by the key of the drone's ``certificate``, of the obeyed revocation: it is invalid with any other revocation.
    """

    drone: Identifier
    certificate: Certificate
    signature: Annotated[bytes, Meta(max_length=SIGNATURE_BYTES)]


class Revoked(DroneMessage, frozen=True, kw_only=True):
    """All revocations that a drone knows, relayed as they were signed.

    ``obeying``: confirmations of the revoked drones known to obey and return; at most one of each drone.
    """

    held: Annotated[tuple[Revocation, ...], Meta(max_length=MOST_HELD)]
    obeying: Annotated[tuple[Obeying, ...], Meta(max_length=MOST_HELD)] = ()
