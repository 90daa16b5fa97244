"""Revocation of a member in flight: an operator withdraws the rights of a drone or of another operator.

All drones then ignore the same later log entries of a revoked drone.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct, field

from radron.protocol.entries import SIGNATURE_BYTES
from radron.protocol.message import DroneMessage, StationMessage
from radron.protocol.units import BootId, Certificate, Count, Identifier, StampNs

MAX_REVOKED_BOOTS = 64  # of a revoked drone, with valid entries
MAX_HELD_REVOCATIONS = 16  # revocations that a drone keeps and relays


class Revocation(StationMessage, frozen=True, kw_only=True):
    """An operator's order to all drones to accept nothing more from a certain member: a drone or another operator.

    Drones use it when a member's key has been stolen. ``member``: name of the revoked member. ``last``: for each boot (run of the
    agent) of a revoked drone, the sequence number of its last log entry that is still evaluated; entries of boots that are not
    listed are ignored. Sequence numbers are used instead of times, as the holder of a stolen key can sign any time stamp.
    ``until_ns``: end of the member's certificates, after which the revocation is void and the name can be used again.
    ``certificate``: of the revoking station, which must have the right to revoke. ``signature``: made with the certificate's key
    over the message without its signature.
    """

    member: Identifier
    until_ns: StampNs
    last: Annotated[dict[BootId, Count], Meta(max_length=MAX_REVOKED_BOOTS)] = field(default_factory=dict)
    certificate: Certificate
    signature: Annotated[bytes, Meta(max_length=SIGNATURE_BYTES)] = b""

    def counts(self, boot: str) -> int:
        """Return the sequence number of the last log entry of a boot that is still evaluated; -1: no entry.

        ``boot``: identity of one run of the drone's agent.
        """
        return self.last.get(boot, -1)

    def covers(self, other: Revocation) -> bool:
        """Return whether this revocation excludes all log entries that the ``other`` revocation excludes, for at least as long.

        Both must name the same member; the other revocation is then redundant.
        """
        lower = all(last <= other.counts(boot) for boot, last in self.last.items())
        return self.member == other.member and self.until_ns >= other.until_ns and lower


class Obeying(Struct, frozen=True, array_like=True):
    """A revoked drone's signed statement that it obeys the revocation and returns.

    Other drones relay the statement, but cannot make it. ``signature``: made with the key of the drone's ``certificate`` over the
    signature of the revocation, so that it is invalid with any other revocation.
    """

    drone: Identifier
    certificate: Certificate
    signature: Annotated[bytes, Meta(max_length=SIGNATURE_BYTES)]


class Revoked(DroneMessage, frozen=True, kw_only=True):
    """All revocations that a drone knows, which it relays to the other drones with their original signatures.

    ``obeying``: statements of revoked drones that they obey and return; at most one of each drone.
    """

    held: Annotated[tuple[Revocation, ...], Meta(max_length=MAX_HELD_REVOCATIONS)]
    obeying: Annotated[tuple[Obeying, ...], Meta(max_length=MAX_HELD_REVOCATIONS)] = ()
