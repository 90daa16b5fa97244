"""The base of all messages."""

from __future__ import annotations

from msgspec import Struct

from protocol.units import DroneId, Identifier, StampNs


class Message(Struct, frozen=True, kw_only=True, tag_field="kind", tag=str.lower):
    """Base of all messages that cross a link."""

    stamp_ns: StampNs

    def flaw(self) -> str | None:
        """Return the inconsistency of this message, with each field within its range; None if there is none."""
        return None


class DroneMessage(Message, frozen=True, kw_only=True):
    """A message that a drone publishes under its own key."""

    drone: DroneId


class StationMessage(Message, frozen=True, kw_only=True):
    """A message that an operator publishes under the key of its station."""

    station: Identifier
