"""A driver of PX4 fed with a real autopilot's bytes, at the times of the recording, as fast as it can be."""

from __future__ import annotations

import json
import lzma
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from radron.agent.config.drone import VehicleConfig
from radron.agent.vehicle.demands import Demands
from radron.agent.vehicle.interface import GnssFix, LaunchPlace, VehicleCommand, VehicleState
from radron.agent.vehicle.mavlink.link import AUTOPILOT_COMPONENT, Received
from radron.agent.vehicle.mavlink.messages import DECODERS, Message
from radron.agent.vehicle.px4 import Px4Vehicle
from support.px4.mavsdk_json import fields_of

FOLDER = Path(__file__).parents[3] / "contract" / "recordings" / "messages"
NAMES = sorted(path.stem for path in FOLDER.glob("*.xz"))
LOOK_S = 0.1  # of the recording's time, between two looks at the driver's state
_HEAD_BYTES, _CHECKSUM_BYTES, _STAMP_BYTES = 10, 2, 8


class Packet(NamedTuple):
    """``time_s``: since the file's first packet."""

    time_s: float
    system: int
    component: int
    data: bytes


def packets(name: str, folder: Path = FOLDER) -> Iterator[Packet]:
    """Of one recording."""
    data, place, first_us = lzma.decompress((folder / f"{name}.xz").read_bytes()), 0, None
    while place < len(data):
        stamp_us, begin = int.from_bytes(data[place : place + _STAMP_BYTES], "big"), place + _STAMP_BYTES
        place = begin + _HEAD_BYTES + data[begin + 1] + _CHECKSUM_BYTES
        packet = data[begin:place]
        first_us = stamp_us if first_us is None else first_us
        yield Packet((stamp_us - first_us) * 1e-6, packet[5], packet[6], packet)


class Asked(NamedTuple):
    time_s: float
    name: str
    fields: dict[str, Any]


class SilentLink:
    """Stand-in for a link: keeps the packets that the driver sends."""

    def __init__(self, clock_s: Callable[[], float]) -> None:
        self.counters: Counter[str] = Counter()
        self.is_signed: bool | None = None
        self.taken_from: str | None = None
        self.asked: list[Asked] = []
        self._clock_s = clock_s

    def send(self, name: str, fields: dict[str, Any]) -> None:
        self.asked.append(Asked(self._clock_s(), name, fields))

    def send_command(self, command: int, *parameters: float | None) -> None:
        self.send("COMMAND_LONG", {"command": command, "parameters": parameters})

    def close(self) -> None:
        """There is nothing to close."""

    def commands(self, number: int) -> list[Asked]:
        return [asked for asked in self.asked if asked.fields.get("command") == number]


class Look(NamedTuple):
    """The driver's state at a time."""

    time_s: float
    state: VehicleState | None
    problems: tuple[str, ...]


class Replay:
    """If a recording begins in flight, the driver belongs to a restarted agent that knows its launch place, which
    is the origin of the autopilot's frame here.

    ``looks``: ten for each second of the recording; ``states``, ``fixes``: all, with their times."""

    def __init__(self, name: str, *, exact: bool = False, **vehicle: Any) -> None:
        """``exact``: the mission knows its frame exactly; ``vehicle``: the vehicle's part of the drone file."""
        self._name = name
        self.now_s, self._begun_ns = 1000.0, 1_795_313_620_000_000_000
        self.link = SilentLink(lambda: self.now_s - 1000.0)
        self.vehicle = Px4Vehicle(
            Demands(VehicleConfig(**vehicle), 60.0),
            self._launch(name),
            clock_ns=lambda: self._utc_ns,
            exact=exact,
            clock_s=lambda: self.now_s,
            link=self.link,  # type: ignore[arg-type]
        )
        self.states: list[tuple[float, VehicleState]] = []
        self.fixes: list[tuple[float, GnssFix]] = []
        self.looks: list[Look] = []
        self.vehicle.on_state(lambda state: self.states.append((self.now_s - 1000.0, state)))
        self.vehicle.on_fix(lambda fix: self.fixes.append((self.now_s - 1000.0, fix)))

    @property
    def _utc_ns(self) -> int:
        return self._begun_ns + round((self.now_s - 1000.0) * 1e9)

    def run(self, command: Callable[[float], VehicleCommand] | None = None) -> Replay:
        """Give the driver everything. ``command``: the command given at each look, by its time; none: no commands."""
        due_s = 0.0
        for time_s, messages in self._received():
            while time_s >= due_s:
                self.now_s = 1000.0 + due_s
                self._look(due_s, command)
                due_s += LOOK_S
            self.now_s = 1000.0 + time_s
            for message in messages:
                self.vehicle._receive([Received(message, self._utc_ns, self.now_s)])
        return self

    def _received(self) -> Iterator[tuple[float, list[Message]]]:
        """The driver's reading of each packet of the recording; the vehicle is the most frequent sender."""
        recorded = list(packets(self._name))
        system = Counter(packet.system for packet in recorded if packet.component == AUTOPILOT_COMPONENT).most_common(1)[0][0]
        for packet in recorded:
            is_own = (packet.system, packet.component) == (system, AUTOPILOT_COMPONENT)
            found = fields_of(packet.data) if is_own else None
            known = found is not None and found[0] in DECODERS
            yield packet.time_s, [DECODERS[found[0]].decode(found[1])] if found is not None and known else []

    def _look(self, time_s: float, command: Callable[[float], VehicleCommand] | None) -> None:
        if command is not None:
            self.vehicle.command(command(time_s))
        state = self.states[-1][1] if self.states and time_s - self.states[-1][0] < 1.0 else None
        self.looks.append(Look(time_s, state, self.vehicle.problems))

    def at(self, time_s: float) -> Look:
        """The driver's states then."""
        return min(self.looks, key=lambda look: abs(look.time_s - time_s))

    def changes(self, of: Callable[[VehicleState], Any]) -> list[tuple[float, Any]]:
        """When something of the state changed, and into what; from its first state on."""
        found: list[tuple[float, Any]] = []
        for time_s, state in self.states:
            value = of(state)
            if not found or found[-1][1] != value:
                found.append((round(time_s, 2), value))
        return found

    @staticmethod
    def _launch(name: str) -> LaunchPlace | None:
        """The origin published by the vehicle."""
        for packet in packets(name):
            found = fields_of(packet.data) if packet.component == AUTOPILOT_COMPONENT else None
            if found is not None and found[0] == "GPS_GLOBAL_ORIGIN":
                origin = json.loads(found[1])
                return LaunchPlace(
                    north_m=0.0,
                    east_m=0.0,
                    down_m=0.0,
                    origin_latitude_deg=origin["latitude"] * 1e-7,
                    origin_longitude_deg=origin["longitude"] * 1e-7,
                    origin_altitude_m=origin["altitude"] * 1e-3,
                )
        return None
