"""The relays of a flight, and the orders to them."""

from __future__ import annotations

from msgspec import Struct

from radron.sim.live.relays.linkstate import LinkState
from radron.sim.vehicle.px4.config import Address


class Carried(Struct, frozen=True):
    """A relay: its dialling end (or the vehicle), the dialled end, its own listening address, and that of the dialled end."""

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
    """Return the vehicle's end of a drone's MAVLink relay; the other end is the drone's agent, by its id."""
    return f"vehicle of {drone}"
