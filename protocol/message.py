"""The base of all messages."""

from __future__ import annotations

from msgspec import Struct

from radron.protocol.units import DroneId, Identifier, StampNs


class Message(Struct, frozen=True, kw_only=True, tag_field="kind", tag=str.lower):
    """Base of all messages that drones and operators' stations send each other.

    ``stamp_ns``: the sender's time, in nanoseconds UTC.
    """

    stamp_ns: StampNs

    def flaw(self) -> str | None:
        """Return an error text if fields contradict each other, although each is within its own range; else None."""
        return None


class DroneMessage(Message, frozen=True, kw_only=True):
    """Base of the messages that a drone publishes under its own key (Zenoh's name of a data stream)."""

    drone: DroneId


class StationMessage(Message, frozen=True, kw_only=True):
    """Base of the messages that an operator publishes under the key of a station (a computer on the ground)."""

    station: Identifier
