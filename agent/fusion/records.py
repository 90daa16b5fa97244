"""Entries of the observation log as their bytes, and two of them that contradict each other."""

from __future__ import annotations

from msgspec import Struct

from protocol.codec import decode_as
from protocol.entries import Entry


class Record(Struct, frozen=True):
    """An entry as its bytes that crossed the link. Decoded it would take four times the memory."""

    kind: type[Entry]
    payload: bytes

    @property
    def entry(self) -> Entry:
        """The entry, decoded anew."""
        return decode_as(self.kind, self.payload)


class Contradiction(Struct, frozen=True):
    """Two entries of one publisher with one sequence number and different bytes: where they are signed, proof that it, or who has
    its key, told different drones different things.
    """

    number: int
    proof: tuple[Record, Record]
