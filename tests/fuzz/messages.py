"""Wire messages into a whole pilot in flight: broken bytes, wrong documents, and valid ones that make no sense, also of members.

A message that is refused counts, and changes nothing else; the pilot goes on making finite commands and valid messages.
"""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from random import Random
from typing import Any

import msgpack
import msgspec
from msgspec.structs import replace

from radron.agent.config.drone import DroneConfig
from radron.agent.config.estimators import FusionConfig
from radron.agent.config.mission import DatumConfig, DroneInMission, MissionConfig
from radron.agent.pilot import Pilot, Step
from radron.agent.vehicle.interface import FlightMode
from radron.protocol.codec import decode_from, encode
from radron.protocol.keys import drone_key, key_of, station_key
from radron.protocol.messages import DRONE_KINDS, KINDS, STATION_KINDS, Status
from support.flights.one_pilot import AREA, MISSION, SECOND, START_NS, command, cone_of, nonce_key_of, state
from tests.fuzz.mutation import HOSTILE_TEXTS, broken, hostile, mutated, nested
from tests.fuzz.target import Probe, Target, expect
from tests.fuzz.valid import documents

EVERY = 30  # examples of each kind
MESSAGES_PER_STEP = 50
COMPARED = 20  # one case in so many is repeated without the refused messages
_MEMBERS = ("d1", "d2", "d3")
_BOOTS = ("2" * 16, "3" * 16, "0" * 15 + "1")
_STAMPS_S = (0, 0, 0, 0, -0.05, -0.5, -1, -3, -20, -100, 0.05, 0.9, 2, 1e5, -1e8)
_MISSIONS = (
    replace(MISSION, drones=(*MISSION.drones, DroneInMission(id="d3", origin_m=(8.0, 0.0, 0.0)))),
    MissionConfig(
        name="fuzz",
        area=AREA,
        fusion=FusionConfig(estimator="bayes"),
        drones=tuple(DroneInMission(id=name, origin_m=(4.0 * place, 0.0, 0.0)) for place, name in enumerate(_MEMBERS)),
    ),
    MissionConfig(
        name="fuzz",
        area=AREA,
        datum=DatumConfig(latitude_deg=50.0, longitude_deg=14.0, altitude_m=300.0),
        drones=(
            DroneInMission(id="d1", localization="gnss"),
            DroneInMission(id="d2", localization="slam", yaw_sigma_deg=180.0, origin_m=(4.0, 0.0, 0.0)),
            DroneInMission(id="d3", localization="rtk", origin_m=(8.0, 0.0, 0.0)),
        ),
    ),
)
_LASTING = ("abort", "land", "return")
_Wire = tuple[str, bytes]


class Messages(Target):
    """Eight million messages."""

    name = "messages"
    inputs = 8_000_000
    batch = 1000
    limit_s = 0.1

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._kinds = documents(EVERY)
        self._all = [one for ones in self._kinds.values() for one in ones]
        self._bytes = [msgpack.packb(one) for one in self._all]

    def case(self, rng: Random, probe: Probe) -> None:
        """A pilot from its start on, with a message each millisecond."""
        mission = rng.choice(_MISSIONS)
        flight = _Flight(mission, rng.randrange(3))
        given: list[tuple[str, bytes, int]] = []
        steps = []
        for number in range(self.batch):
            key, payload = self._message(rng, mission, flight.now_ns)
            if not flight.hear(probe, key, payload):
                given.append((key, payload, number))
            if (number + 1) % MESSAGES_PER_STEP == 0:
                steps.append(flight.step(probe))
        if rng.randrange(COMPARED) == 0:
            _compare(mission, flight.begun, given, steps)

    def _message(self, rng: Random, mission: MissionConfig, now_ns: int) -> _Wire:
        pick = rng.random()
        if pick < 0.03:
            return self._key(rng, mission), rng.randbytes(rng.choice((0, 1, 10, 100, 3000)))
        if pick < 0.05:
            return self._key(rng, mission), _monster(rng)
        fields = self._fields(rng)
        if pick < 0.1:
            return self._key(rng, mission), broken(rng, msgpack.packb(fields), self._bytes)
        fields = _of_member(rng, fields, mission, now_ns)
        key = _key_of(mission, fields)
        if pick < 0.5:  # valid, whatever it claims
            return key, msgpack.packb(fields)
        if pick < 0.75:
            return key, _packed(mutated(rng, fields))
        if pick < 0.95:
            return key, broken(rng, msgpack.packb(fields), self._bytes)
        return self._key(rng, mission), msgpack.packb(fields)

    def _fields(self, rng: Random) -> dict[str, Any]:
        """An example of any kind; hardly any that ends the mission."""
        fields = rng.choice(self._all)
        if fields.get("action") in _LASTING and rng.random() < 0.99:
            return {**fields, "action": rng.choice(("start", "hold", "resume"))}
        return fields

    def _key(self, rng: Random, mission: MissionConfig) -> str:
        """A key that is right, odd, or none."""
        if rng.random() < 0.2:
            right = station_key(mission.swarm, "operator", rng.choice(list(STATION_KINDS)))
        else:
            right = drone_key(mission.swarm, rng.choice(_MEMBERS), rng.choice(list(DRONE_KINDS)))
        if rng.random() < 0.5:
            return right
        parts = right.split("/")
        parts[rng.randrange(len(parts))] = rng.choice(("*", "**", "1", "D1", "other", "command", "log", "alive", *HOSTILE_TEXTS))
        return "/".join(parts[: rng.choice((0, 3, 4, 6, 6, 6))])


class _Flight:
    """A pilot in the air, and its inputs besides messages. ``begun``: how it got there."""

    def __init__(self, mission: MissionConfig, begun: int) -> None:
        self.begun = begun
        self.now_ns = START_NS
        self._pilot = Pilot(mission, DroneConfig(id="d1"), boot=_BOOTS[-1], nonce_key=nonce_key_of(_BOOTS[-1]))
        self._pilot.observe_vehicle(state(START_NS, armed=begun > 0, in_air=begun > 0))
        if begun:
            self._pilot.receive(*command(mission=mission), START_NS)
            self._pilot.step(START_NS)
        if begun == 2:
            for sequence in range(20):
                cone = replace(cone_of("d2", sequence, START_NS + sequence * SECOND // 5), mission=mission.mission_id)
                self._pilot.receive(key_of(mission.swarm, cone), encode(cone), cone.stamp_ns)
            self.now_ns += 5 * SECOND

    def hear(self, probe: Probe, key: str, payload: bytes) -> bool:
        """Whether the message was refused."""
        pilot, counters = self._pilot, self._pilot.counters
        before = counters["rejected_malformed"] + counters["dropped_other_swarm"], len(pilot.fusion.log), pilot.stage
        probe.feed(msgpack.packb((key, payload)), pilot.receive, key, payload, self.now_ns)
        self.now_ns += 1_000_000
        after = counters["rejected_malformed"] + counters["dropped_other_swarm"], len(pilot.fusion.log), pilot.stage
        refused = after[0] > before[0]
        expect(not refused or after[1:] == before[1:], "a message that was refused has an effect")
        return refused

    def step(self, probe: Probe | None = None) -> Step:
        """Telemetry and a step."""
        pilot = self._pilot
        airborne = self.begun > 0
        pilot.observe_vehicle(state(self.now_ns, FlightMode.OFFBOARD, armed=airborne, in_air=airborne))
        step = pilot.step(self.now_ns) if probe is None else probe.timed(pilot.step, self.now_ns)
        setpoint = step.command.setpoint
        if setpoint is not None:
            numbers = (*setpoint.position_m, *setpoint.velocity_mps, *setpoint.acceleration_mps2, setpoint.yaw_rad)
            expect(isfinite(sum(numbers) + setpoint.yaw_rate_rps), "a setpoint that is not finite")
        for key, payload in step.publications:
            decode_from(key, payload)
        if pilot.hypothesis is not None:
            expect(all(map(isfinite, pilot.hypothesis.position.tolist())), "a hypothesis that is not finite")
        return step


def _compare(mission: MissionConfig, begun: int, given: list[tuple[str, bytes, int]], steps: list[Step]) -> None:
    """The same flight without the refused messages: the same, but for the published counters."""
    flight, waiting = _Flight(mission, begun), iter([*given, ("", b"", 1 << 62)])
    key, payload, number = next(waiting)
    first_ns = flight.now_ns
    for place, step in enumerate(steps):
        while number < (place + 1) * MESSAGES_PER_STEP:
            flight._pilot.receive(key, payload, first_ns + number * 1_000_000)
            key, payload, number = next(waiting)
        flight.now_ns = first_ns + (place + 1) * MESSAGES_PER_STEP * 1_000_000
        expect(_told(flight.step()) == _told(step), "messages that were refused change the flight")


def _told(step: Step) -> tuple[Any, list[Any]]:
    messages = [decode_from(key, payload) for key, payload in step.publications]
    return step.command, [replace(one, counters={}) if isinstance(one, Status) else one for one in messages]


def _of_member(rng: Random, fields: dict[str, Any], mission: MissionConfig, now_ns: int) -> dict[str, Any]:
    """The document as one of the swarm's would send it now, in many cases."""
    copy = dict(fields)
    name = "station" if "station" in copy else "drone"
    copy[name] = "operator" if name == "station" else rng.choice(_MEMBERS[1:] if rng.random() < 0.9 else (*_MEMBERS, "x"))
    if "mission" in copy and rng.random() < 0.95:
        copy["mission"] = mission.mission_id
    if "boot" in copy:
        copy["boot"] = rng.choice(_BOOTS)
    if "epoch" in copy and rng.random() < 0.8:
        copy["epoch"] = 0
    if "sequence" in copy and rng.random() < 0.9:
        copy["sequence"] = rng.randrange(2000)
    if "target" in copy:
        copy["target"] = rng.choice([one for one in (*_MEMBERS, "x") if one != copy["drone"]])
    if rng.random() < 0.95:
        stamp = max(0, now_ns + int(rng.choice(_STAMPS_S) * SECOND))
        if "end_ns" in copy:
            copy["end_ns"] += stamp - copy["stamp_ns"]
        copy["stamp_ns"] = stamp
    return copy


def _key_of(mission: MissionConfig, fields: dict[str, Any]) -> str:
    if fields["kind"] in STATION_KINDS:
        return station_key(mission.swarm, fields["station"], fields["kind"])
    return drone_key(mission.swarm, fields["drone"], fields["kind"])


def _packed(document: Any) -> bytes:
    try:
        return bytes(msgpack.packb(document))
    except (OverflowError, ValueError):  # a number that msgpack has no form for
        return b"\xcf" + b"\xff" * 8


def _monster(rng: Random) -> bytes:
    """Input that a reader may choke on: depth, claimed sizes, keys that are no texts, extensions."""
    depth = rng.choice((10, 100, 511, 513, 1025, 20_000))
    return rng.choice(
        (
            b"\x91" * depth,
            b"\x91" * depth + b"\0",
            b"\x81\x00" * depth + b"\0",
            b"\xdd\xff\xff\xff\xff",
            b"\xdf\xff\xff\xff\xff",
            b"\xdb\xff\xff\xff\xff",
            b"\xc6\xff\xff\xff\xff",
            b"\xc9\xff\xff\xff\xff\x00",
            b"\xd6\xff" + rng.randbytes(4),
            b"\xde\x04\x00" + b"\0" * 4000,
            msgpack.packb({"kind": rng.choice(list(KINDS)), "x": nested(min(depth, 500))}),
            msgpack.packb({"kind": rng.choice(list(KINDS)), **{f"x{place}": hostile(rng) for place in range(126)}})
            if depth > 100
            else msgpack.packb({1: 2, b"kind": "pose"}),
            msgpack.packb([rng.choice(list(KINDS))] * 1000),
            msgspec.msgpack.encode({"kind": "pose", "stamp_ns": 2**64 - 1}) * rng.choice((1, 2)),
        )
    )
