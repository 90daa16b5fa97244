"""The relays of a live flight (which impair its links), and the orders to them."""

from __future__ import annotations

from msgspec import Struct

from radron.sim.live.relays.linkstate import LinkState
from radron.sim.vehicle.px4.config import Address


class Carried(Struct, frozen=True):
    """One relay in a link.

    ``dials``: its dialling end (or the vehicle). ``dialled``: the other end. ``port``: listening port of the relay. ``target``:
    listening address of the other end.
    """

    dials: str
    dialled: str
    port: int
    target: Address


class RelayPlan(Struct, frozen=True):
    """All relays of a live flight. ``mesh``: between two agents; ``mavlink``: between a vehicle and its agent."""

    seed: int
    host: str
    mesh: tuple[Carried, ...]
    mavlink: tuple[Carried, ...]


class Impair(Struct, frozen=True):
    """Order to set the impairment of one direction of a link, by the names of its ends in the plan."""

    sender: str
    receiver: str
    state: LinkState


def vehicle_of(drone: str) -> str:
    """Return the name of the vehicle's end of a drone's MAVLink relay.

    The other end is the drone's agent, with the drone's id as its name.
    """
    return f"vehicle of {drone}"
