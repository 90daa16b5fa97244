"""MAVLink packets of an autopilot into the agent's link, driver and pilot, and packets of companions into the emulated PX4."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite, nan
from pathlib import Path
from random import Random
from typing import Any

import msgspec
import numpy as np
from mavsdk.plugins.mavlink_direct import MavlinkMessage
from pymavlink.dialects.v20 import common

from radron.agent.config.drone import DroneConfig, VehicleConfig
from radron.agent.config.mission import DatumConfig, DroneInMission
from radron.agent.pilot import Pilot
from radron.agent.vehicle.demands import Demands
from radron.agent.vehicle.interface import GnssFix, Request, Setpoint, VehicleCommand, VehicleState
from radron.agent.vehicle.mavlink.link import Link
from radron.agent.vehicle.mavlink.messages import DECODERS
from radron.agent.vehicle.px4 import Px4Vehicle
from radron.sim.vehicle.multirotor import Multirotors, MultirotorTruth
from radron.sim.vehicle.px4.config import Px4Config
from radron.sim.vehicle.px4.fleet import Px4Fleet
from radron.sim.world.localization import Localization, LocalizationTruth
from support.flights.one_pilot import MISSION
from support.px4.linked import CEILING_M, PARAMETERS, STEP_S, UTC_NS
from support.px4.mavsdk_json import fields_of
from tests.fuzz.mutation import broken, mutated
from tests.fuzz.packets import from_companion, odd_payload, recorded
from tests.fuzz.target import Probe, Target, expect

PACKETS_PER_LOOK = 50
_MISSION = msgspec.structs.replace(
    MISSION,
    datum=DatumConfig(latitude_deg=47.4, longitude_deg=8.5, altitude_m=500.0),
    drones=(DroneInMission(id="d1", localization="gnss"), DroneInMission(id="d2")),
)
_SETPOINT = Setpoint((1.0, 2.0, 3.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0)


class _Loop:
    """Stand-in for the event loop: calls wait."""

    def __init__(self) -> None:
        self.waiting: list[Callable[[], None]] = []

    def is_closed(self) -> bool:
        return False

    def call_soon_threadsafe(self, call: Callable[[], None]) -> None:
        self.waiting.append(call)


class _Direct:
    """In the place of MAVSDK's sender."""

    def __init__(self) -> None:
        self.sent: list[MavlinkMessage] = []

    def send_message(self, message: MavlinkMessage) -> None:
        self.sent.append(message)


class AgentLink(Target):
    """A million packets of an autopilot: malformed ones are counted, the others lead to telemetry that the pilot can take."""

    name = "mavlink"
    inputs = 1_000_000
    batch = 1000
    limit_s = 0.1

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        known = {
            number: [packet for packet in ones if (fields_of(packet) or ("",))[0] in DECODERS]
            for number, ones in recorded().items()
        }
        self._packets = [ones for ones in known.values() if ones]

    def case(self, rng: Random, probe: Probe) -> None:
        """An agent from its start on, with 200 packets a second."""
        agent = _Agent(rng)
        for number in range(self.batch):
            packet = rng.choice(rng.choice(self._packets))
            pick = rng.random()
            found = fields_of(packet if pick < 0.35 else odd_payload(rng, packet))
            if found is None:
                continue
            name, text = found
            if pick > 0.9:
                text = self._odd_text(rng, text)
            system, component = rng.choice(((1, 1),) * 20 + ((2, 1), (1, 195), (255, 190)))
            probe.feed(f"{name} {text}".encode(errors="replace"), agent.hear, name, text, system, component)
            if number % PACKETS_PER_LOOK == 0:
                probe.timed(agent.look, rng)

    def _odd_text(self, rng: Random, text: str) -> str:
        """JSON with other values, or broken."""
        if rng.random() < 0.6:
            return msgspec.json.encode(mutated(rng, msgspec.json.decode(text))).decode()
        return broken(rng, text.encode()).decode("utf-8", errors="replace")


class _Agent:
    """Link, driver and pilot of one drone."""

    def __init__(self, rng: Random) -> None:
        self.now_s = 100.0
        self._loop, self._direct = _Loop(), _Direct()
        self._link = Link("udpin://0.0.0.0:14540", self._now_ns, lambda: self.now_s)
        gnss = rng.random() < 0.8
        self._pilot = Pilot(_MISSION, DroneConfig(id="d1"), boot="1" * 16, nonce_key=b"")
        self._vehicle = Px4Vehicle(
            Demands(VehicleConfig(gnss=gnss), CEILING_M),
            None,
            self._now_ns,
            rng.random() < 0.5,
            clock_s=lambda: self.now_s,
            link=self._link,
        )
        self._vehicle.on_state(self._take)
        self._vehicle.on_fix(self._take_fix)
        link: Any = self._link
        link._loop, link._direct, link._system_id, link._receive = self._loop, self._direct, 1, self._vehicle._receive

    def _now_ns(self) -> int:
        return UTC_NS + round(self.now_s * 1e9)

    def _take(self, state: VehicleState) -> None:
        self._pilot.observe_vehicle(state)

    def _take_fix(self, fix: GnssFix) -> None:
        self._pilot.observe_fix(fix)

    def hear(self, name: str, text: str, system: int, component: int) -> None:
        """A message as MAVSDK reports it, and the loop's calls then."""
        self.now_s += 0.005
        self._link._arrived(MavlinkMessage(name, system, component, 0, 0, text), None)
        waiting, self._loop.waiting = self._loop.waiting, []
        for call in waiting:
            call()

    def look(self, rng: Random) -> None:
        """The shell's actions twice a second, and a step."""
        self._pilot.block(self._vehicle.problems)
        step = self._pilot.step(self._now_ns())
        self._vehicle.command(step.command)
        self._vehicle.command(VehicleCommand(rng.choice(list(Request)), _SETPOINT))
        expect(self._vehicle.launch is None or isfinite(self._vehicle.launch.north_m), "a launch place that is not finite")
        for message in self._direct.sent:
            expect("NaN" not in message.fields_json, "a message to the autopilot that is not JSON")
        self._direct.sent.clear()


_KINDS = (
    *("HEARTBEAT", "COMMAND_LONG", "COMMAND_INT", "SET_MODE", "SET_POSITION_TARGET_LOCAL_NED", "PARAM_REQUEST_READ"),
    *("PARAM_REQUEST_LIST", "PARAM_SET", "TIMESYNC", "ODOMETRY", "PING", "SET_GPS_GLOBAL_ORIGIN", "STATUSTEXT", "COMMAND_ACK"),
    *("MISSION_REQUEST_LIST", "MISSION_CLEAR_ALL", "MISSION_COUNT"),
)
_COMMANDS = (16, 17, 20, 21, 22, 84, 176, 400, 401, 410, 420, 510, 511, 512, 519, 520, 521, 246, 43003, 31010, 0, 65535)


class EmulatedPx4(Target):
    """Half a million packets of companions and others into an emulated PX4, which refuses or ignores what makes no sense."""

    name = "px4"
    inputs = 500_000
    batch = 500
    limit_s = 0.1

    def case(self, rng: Random, probe: Probe) -> None:
        """A vehicle from its start on, with five packets for each step."""
        numbers = np.random.default_rng(rng.getrandbits(32))
        motion = Multirotors(MultirotorTruth(), np.zeros((1, 3)), np.zeros(1), STEP_S, numbers)
        error = Localization(LocalizationTruth(), 1, STEP_S, numbers)
        config = Px4Config(onboard=("127.0.0.1", 1), parameters=PARAMETERS | {"EKF2_EV_CTRL": rng.choice((0, 15))})
        now_ns = UTC_NS
        fleet = Px4Fleet([config], motion, error, STEP_S, numbers, clock_ns=lambda: now_ns)
        link = fleet.faces[0].links[0]
        sent: list[bytes] = []
        link.attach(sent.append)
        sender = common.MAVLink(None, *rng.choice(((1, 195), (255, 190), (2, 1))))
        for _ in range(100):
            fleet.step()
        for number in range(self.batch):
            data = _to_vehicle(rng, sender)
            now_ns += 2_000_000
            probe.feed(data, link.hear, data, now_ns)
            if number % 5 == 0:
                with np.errstate(all="ignore"):  # parameters may be NaN: then it flies like that
                    probe.timed(fleet.step)
                sent.clear()


def _to_vehicle(rng: Random, sender: common.MAVLink) -> bytes:
    data = from_companion(rng, _KINDS, sender, 1)
    pick = rng.random()
    if pick < 0.4:  # a command that it knows
        values = [
            rng.choice((0.0, 1.0, nan, 4.0, 6.0, 29.0, 21196.0, rng.uniform(-100, 100), float("inf"), 1e30)) for _ in range(7)
        ]
        data = common.MAVLink_command_long_message(1, 1, rng.choice(_COMMANDS), 0, *values).pack(sender)
    if pick > 0.95:
        return rng.randbytes(rng.choice((1, 12, 300)))
    if pick > 0.85:
        return broken(rng, data)
    return data * rng.choice((1, 1, 1, 2))
