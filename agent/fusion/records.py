"""Entries of the observation log as their bytes, and pairs of contradicting entries."""

from __future__ import annotations

from msgspec import Struct

from radron.protocol.codec import decode_as
from radron.protocol.entries import Entry


class Record(Struct, frozen=True):
    """An entry as its received bytes. Decoded it would take four times the memory."""

    kind: type[Entry]
    payload: bytes

    @property
    def entry(self) -> Entry:
        """The entry, decoded anew."""
        return decode_as(self.kind, self.payload)


class Contradiction(Struct, frozen=True):
    """Two entries of one publisher with one sequence number and different bytes. If both are signed: proof that the publisher, or
    another owner of its key, has sent different data to different drones.
    """

    number: int
    proof: tuple[Record, Record]
