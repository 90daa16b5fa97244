"""Messages between the world process of a live flight and its launcher, over the pipes between them."""

from __future__ import annotations

import asyncio
from enum import StrEnum
from typing import Literal

import msgspec
from msgspec import Struct

from radron.sim.geometry import Quaternion, Vector3
from radron.sim.scenario import Scenario
from radron.sim.vehicle.px4.config import Address
from radron.sim.vehicle.px4.faults import VehicleFault
from radron.sim.vehicle.px4.fleet import VehicleReport
from radron.sim.world.sources import Source, place_of

_LENGTH_BYTES = 4


class WorldConfig(Struct, frozen=True, kw_only=True):
    """Configuration of the world process of a live flight.

    vehicles: emulated here; or flown by other programs, and observed over their ground-station links. onboard: address to which
    each emulated vehicle sends its onboard MAVLink link. ground_station: address of the ground-station links: emulated vehicles
    send to it, for other vehicles the world listens there. feed_host, feed_ports: listening address of each camera's feed; port
    0: a free one. vision_ports, sightings_ports: ports for SLAM poses and relative observations; empty: free ports. calibrations:
    folders for the files of each camera's own calibration; empty: not written.
    """

    scenario: Scenario
    seed: int
    vehicles: Literal["emulated", "mavlink"] = "emulated"
    onboard: tuple[Address, ...]
    ground_station: Address | None = None
    feed_host: str = "127.0.0.1"
    feed_ports: tuple[int, ...] = ()
    vision_ports: tuple[int, ...] = ()
    sightings_ports: tuple[int, ...] = ()
    calibrations: tuple[str, ...] = ()


class Order(StrEnum):
    """The launcher's orders to the world process, one per line on its standard input.

    Orders for one drone are followed by its index, ``BREAK`` and ``MEND`` also by the fault. The end of the stream ends the
    world.
    """

    GO = "go"  # the mission begins: the source appears, and moves
    CAMERAS_OFF = "cameras off"  # no more readouts
    SATELLITES_OFF = "satellites off"  # one vehicle's receiver loses reception
    SATELLITES_ON = "satellites on"
    CAMERA_OFF = "camera off"  # one camera gives no more readouts
    CAMERA_ON = "camera on"
    PILOT_MANUAL = "pilot manual"  # a safety pilot overrides a vehicle by remote control: by hand, or by choosing a mode
    PILOT_HOLD = "pilot hold"
    PILOT_RETURN = "pilot return"
    PILOT_LAND = "pilot land"
    BREAK = "break"  # a fault strikes one vehicle; followed by the fault as JSON, like the next order
    MEND = "mend"


class Ready(Struct, frozen=True, tag="ready"):
    """Message from the world process that it is ready, with the ports of its sensor feeds.

    ``feed_ports``: of each vehicle's camera; empty if they are not read. ``vision_ports``: of each vehicle's SLAM, 0 without
    SLAM. ``sightings_ports``: of each vehicle's sensor for relative observations; empty without sensors.
    """

    feed_ports: tuple[int, ...]
    vision_ports: tuple[int, ...] = ()
    sightings_ports: tuple[int, ...] = ()


class Truth(Struct, frozen=True, tag="truth"):
    """The true state of the world at one time; mission frame (ENU), metres.

    time_s: since the world began; stamp_ns: nanoseconds UTC at this time. attitude: quaternions (w, x, y, z) that rotate from
    body to world. position_m, velocity_mps: of the vehicles. sources: empty before the mission's start. late_s: largest lag of
    the world behind the clock since the last message. dropped: earlier messages that the launcher was too slow to read.
    """

    time_s: float
    position_m: tuple[Vector3, ...]
    velocity_mps: tuple[Vector3, ...]
    sources: tuple[Source, ...]
    vehicles: tuple[VehicleReport, ...]
    late_s: float
    dropped: int
    stamp_ns: int = 0
    attitude: tuple[Quaternion, ...] = ()

    @property
    def source_m(self) -> tuple[float, float] | None:
        """Position of the first source; None without one."""
        return place_of(self.sources)


_fault_decoder = msgspec.json.Decoder(VehicleFault)


def order_line(order: Order, drone: int | None, fault: VehicleFault | None) -> bytes:
    """Return an order to the world process as a line of bytes. ``drone``: index of the drone concerned."""
    parts = [str(order)] if drone is None else [f"{order}: {drone}"]
    if fault is not None:
        parts.append(msgspec.json.encode(fault).decode())
    return " ".join(parts).encode() + b"\n"


def read_order(line: bytes) -> tuple[Order, int, VehicleFault | None]:
    """Return order, drone and fault from such a line; without a drone the index is 0."""
    order, _, more = line.decode().strip().partition(": ")
    drone, _, fault = more.partition(" ")
    return Order(order), int(drone or 0), _fault_decoder.decode(fault) if fault else None


_decoder = msgspec.msgpack.Decoder(Ready | Truth)


def pack(message: Ready | Truth) -> bytes:
    """Return a message from the world process as bytes, with its length as prefix."""
    payload = msgspec.msgpack.encode(message)
    return len(payload).to_bytes(_LENGTH_BYTES, "big") + payload


async def read(stream: asyncio.StreamReader) -> Ready | Truth | None:
    """Return the next message from the world process; None at the end of the stream."""
    try:
        length = int.from_bytes(await stream.readexactly(_LENGTH_BYTES), "big")
        message: Ready | Truth = _decoder.decode(await stream.readexactly(length))
        return message
    except asyncio.IncompleteReadError:
        return None
