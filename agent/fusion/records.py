"""Entries of the observation log as their bytes, and pairs of contradicting entries."""

from __future__ import annotations

from msgspec import Struct

from radron.protocol.codec import decode_as
from radron.protocol.entries import Entry


class Record(Struct, frozen=True):
    """A log entry (signed measurement) as its received bytes, which take a quarter of the memory of the decoded entry."""

    kind: type[Entry]
    payload: bytes

    @property
    def entry(self) -> Entry:
        """The log entry, decoded from its bytes again at each access."""
        return decode_as(self.kind, self.payload)


class Contradiction(Struct, frozen=True):
    """Two different log entries of one publisher under one sequence number.

    If both are signed, they prove that the publisher, or another owner of its key, has sent different data to different drones.
    """

    number: int
    proof: tuple[Record, Record]
