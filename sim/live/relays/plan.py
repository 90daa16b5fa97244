"""Which relays a flight has, and the orders to them."""

from __future__ import annotations

from msgspec import Struct

from sim.live.relays.linkstate import LinkState
from sim.vehicle.px4.config import Address


class Carried(Struct, frozen=True):
    """A relay: who dials (or is the vehicle), who is dialled, where it listens, and where that one listens."""

    dials: str
    dialled: str
    port: int
    target: Address


class RelayPlan(Struct, frozen=True):
    """All relays of a flight. ``mesh``: between two agents; ``mavlink``: between a vehicle and its agent."""

    seed: int
    host: str
    mesh: tuple[Carried, ...]
    mavlink: tuple[Carried, ...]


class Impair(Struct, frozen=True):
    """The state of one direction from now on, by the names of its ends in the plan."""

    sender: str
    receiver: str
    state: LinkState


def vehicle_of(drone: str) -> str:
    """The end of a MAVLink relay that is the drone's vehicle; the other end is the drone's agent, by its id."""
    return f"vehicle of {drone}"
