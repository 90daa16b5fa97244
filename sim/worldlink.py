"""What the world process and its launcher say to each other over the pipes between them."""

from __future__ import annotations

import asyncio
from enum import StrEnum
from typing import Literal

import msgspec
from msgspec import Struct

from sim.scenario import Scenario
from sim.vehicle.px4.config import Address
from sim.vehicle.px4.fleet import VehicleReport

Vector3 = tuple[float, float, float]
_LENGTH_BYTES = 4


class WorldConfig(Struct, frozen=True, kw_only=True):
    """What a world is made of.

    vehicles: emulated here; or flown by somebody else, and followed by their ground-station links.
    onboard: where each emulated vehicle sends its onboard MAVLink link.
    ground_station: where the ground-station links end: the emulated vehicles send to it, others are listened to there.
    feed_host, feed_ports: where each camera's feed listens; port 0 takes a free one. vision_ports, sightings_ports: likewise the
    poses of each SLAM, and what sees the other drones; empty: at free ports.
    calibrations: folders for the files of each camera's own calibration; empty: nobody reads them.
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
    """What the launcher tells the world, a line each on its standard input. The end of that stream ends the world."""

    GO = "go"  # the mission begins: the source is there, and moves
    CAMERAS_OFF = "cameras off"  # no more readouts


class Ready(Struct, frozen=True, tag="ready"):
    """The world is up. ``feed_ports``: of each vehicle's camera; empty where nobody reads them.

    ``vision_ports``: of each vehicle's SLAM, 0 where it has none. ``sightings_ports``: of each vehicle's sensor that sees the
    others; empty where they have none.
    """

    feed_ports: tuple[int, ...]
    vision_ports: tuple[int, ...] = ()
    sightings_ports: tuple[int, ...] = ()


class Truth(Struct, frozen=True, tag="truth"):
    """The world at one instant; mission frame (ENU), metres.

    time_s: since the world began. position_m, velocity_mps: of the vehicles. late_s: by how much the world was behind the clock
    at worst since the last one. dropped: truths before this one that the launcher was too slow to take.
    """

    time_s: float
    position_m: tuple[Vector3, ...]
    velocity_mps: tuple[Vector3, ...]
    source_m: tuple[float, float] | None
    vehicles: tuple[VehicleReport, ...]
    late_s: float
    dropped: int


_decoder = msgspec.msgpack.Decoder(Ready | Truth)


def pack(message: Ready | Truth) -> bytes:
    """A message with its length in front."""
    payload = msgspec.msgpack.encode(message)
    return len(payload).to_bytes(_LENGTH_BYTES, "big") + payload


async def read(stream: asyncio.StreamReader) -> Ready | Truth | None:
    """The next message; None where the stream has ended."""
    try:
        length = int.from_bytes(await stream.readexactly(_LENGTH_BYTES), "big")
        message: Ready | Truth = _decoder.decode(await stream.readexactly(length))
        return message
    except asyncio.IncompleteReadError:
        return None
