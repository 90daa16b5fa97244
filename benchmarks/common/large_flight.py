"""Construction of a long flight of many drones from a simulated flight of three drones.

The source is a point at rest on level ground, so a flight turned about the source is as possible as the flight itself. Each group
of three among the many drones flies the path of the three drones, turned by an angle of its own. Measurements are unchanged in
the local frames; the mission gives the turned poses of the frames. While all drones track, the flight is repeated from there on,
for as long as needed; at the seams the drones jump by a few metres. Nothing is signed.
"""

from __future__ import annotations

from collections.abc import Iterator
from heapq import merge
from math import cos, degrees, pi, radians, sin
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from msgspec.structs import replace

from radron.agent.config.mission import DroneInMission, MissionConfig
from radron.agent.flight import topics
from radron.agent.flight.recorded import RecordedPilot
from radron.agent.pilot import Pilot
from radron.protocol.codec import decode
from radron.protocol.entries import Credential, Entry, Exposure
from radron.protocol.keys import drone_key
from radron.protocol.messages import Estimate, Stage, Status
from radron.sim.lockstep.flight import watched
from radron.sim.scenario import load_scenario, override

FLOWN = 3
TRACKED_S = 60.0  # flown, and repeated
# Thirty drones that keep their separation of 3 m need a circle of at least 14.4 m; the rates follow from the distance.
CIRCLE = {"mission.encirclement.nearest_m": 16.0, "mission.encirclement.radius_m": 20.0}
MARGIN_NS = 1_000_000_000  # of tracking, before the repeated part
BOOT = "0" * 16
_encode = msgspec.msgpack.Encoder().encode


class Sent(NamedTuple):
    """A message, and when its drone sends it."""

    at_ns: int
    drone: str
    key: str
    payload: bytes


def fly(path: Path, seed: int = 1) -> None:
    """Fly the three, and write what each of them sends, with its times."""
    kept: list[_Kept] = []

    def made(*args: Any, **kwargs: Any) -> Any:
        kept.append(_Kept())
        return _Pilot(Pilot(*args, **kwargs), kept[-1])

    watched(_scenario(), seed, lambda moment: False, made)
    path.write_bytes(_encode([one.sent for one in kept]))


class LargeFlight:
    """``mission``: of all drones."""

    def __init__(self, drones: int, flown: Path) -> None:
        """``flown``: what ``fly`` has written."""
        read = msgspec.msgpack.decode(flown.read_bytes(), type=list[list[tuple[int, bytes]]])
        self._flown = [[(at_ns, decode(payload)) for at_ns, payload in sent] for sent in read]
        tracking = [
            [at_ns for at_ns, message in sent if isinstance(message, Status) and message.stage is Stage.TRACK]
            for sent in self._flown
        ]
        self._began_ns = min(sent[0][0] for sent in self._flown)
        self._seam_ns = max(times[0] for times in tracking) + MARGIN_NS
        self._period_ns = min(times[-1] for times in tracking) - self._seam_ns
        source = next(message for _, message in reversed(self._flown[0]) if isinstance(message, Estimate)).sources[0]
        self.mission = _multiplied(_scenario().mission, drones, source.position_m[:2])

    def sent(self, begin_ns: int, first_s: float, seconds: float, boot: str = BOOT) -> Iterator[Sent]:
        """The messages from ``first_s`` up to ``seconds`` after the beginning, in the order of their times.

        ``boot``: of all drones; a part of the flight that is not sent from its beginning needs one of its own.
        """
        later_ns = begin_ns - self._began_ns
        first_ns, end_ns = (self._began_ns + round(time_s * 1e9) for time_s in (first_s, seconds))
        copies = [_Copy(self.mission, place, later_ns, boot) for place in range(len(self.mission.drones))]
        for at_ns, flown, message in merge(*(self._endless(flown) for flown in range(FLOWN)), key=lambda one: one[0]):
            if at_ns >= end_ns:
                return
            if at_ns >= first_ns:
                for copy in copies[flown::FLOWN]:
                    yield copy.sent(at_ns + later_ns, at_ns - message[0] + later_ns, message[1])

    def _endless(self, flown: int) -> Iterator[tuple[int, int, tuple[int, Any]]]:
        """(time, drone, (time when flown, message)): a drone's messages up to the seam, then the period after it again and
        again."""
        sent = self._flown[flown]
        yield from ((one[0], flown, one) for one in sent if one[0] < self._seam_ns)
        again = [one for one in sent if self._seam_ns <= one[0] < self._seam_ns + self._period_ns]
        later_ns = 0
        while True:
            yield from ((one[0] + later_ns, flown, one) for one in again)
            later_ns += self._period_ns


class _Copy:
    """Makes the messages of the drone at a place of the mission."""

    def __init__(self, mission: MissionConfig, place: int, later_ns: int, boot: str) -> None:
        """``later_ns``: shift against the flown messages."""
        self._mission, self._later_ns, self._boot = mission, later_ns, boot
        self._name = mission.drones[place].id
        self._others = {  # as heard by the drone that was flown
            drone.id: f"d{other % FLOWN + 1}"
            for other, drone in enumerate(mission.drones)
            if other != place and other % FLOWN != place % FLOWN
        }
        self._sequence = 0
        self._keys: dict[type, str] = {}

    def sent(self, at_ns: int, shift_ns: int, message: Any) -> Sent:
        """A message of the drone that was flown, as this one sends it ``shift_ns`` later."""
        changed: dict[str, Any] = {"stamp_ns": message.stamp_ns + shift_ns, "drone": self._name}
        if isinstance(message, Entry):
            self._sequence += 1
            changed |= {"mission": self._mission.mission_id, "boot": self._boot, "sequence": self._sequence}
            if isinstance(message, Exposure):
                changed["end_ns"] = message.end_ns + shift_ns
        elif isinstance(message, Status):
            delays_ns = {drone: message.delays_ns[heard] for drone, heard in self._others.items() if heard in message.delays_ns}
            started_ns = message.started_ns and message.started_ns + self._later_ns
            changed |= {"mission": self._mission.mission_id, "boot": self._boot, "delays_ns": delays_ns, "started_ns": started_ns}
        elif isinstance(message, Estimate):
            changed["mission"] = self._mission.mission_id
        kind = type(message)
        if kind not in self._keys:
            self._keys[kind] = drone_key(self._mission.swarm, self._name, kind.__name__.lower())
        return Sent(at_ns, self._name, self._keys[kind], _encode(replace(message, **changed)))


class _Pilot(RecordedPilot):
    """Takes a pilot's place in the lockstep."""

    def __init__(self, pilot: Pilot, kept: _Kept) -> None:
        super().__init__(pilot, kept)
        self.fusion, self.listeners = pilot.fusion, pilot.listeners


class _Kept:
    """A drone's message, as received by the recorder."""

    def __init__(self) -> None:
        self.sent: list[tuple[int, bytes]] = []

    def write(self, topic: str, data: bytes, log_ns: int | None = None) -> None:
        """Keep a publication."""
        if topic == topics.PUBLICATION and log_ns is not None:
            message = decode(topics.decode_message(data)[1])
            if not isinstance(message, Credential):
                proofs = {"proof": b""} if isinstance(message, Entry) else {}
                if isinstance(message, Status):
                    proofs = {"certificate": b"", "signature": b""}
                self.sent.append((log_ns, _encode(replace(message, **proofs))))


def _scenario() -> Any:
    return override(load_scenario("paper-demo"), {**CIRCLE, "mission.track.duration_s": TRACKED_S})


def _multiplied(mission: MissionConfig, count: int, middle: tuple[float, ...]) -> MissionConfig:
    """A mission of ``count`` drones: the given mission's drones again and again, turned about the middle."""
    drones: list[DroneInMission] = []
    turns = -(-count // FLOWN)
    for turn in range(turns):
        angle = 2.0 * pi * turn / turns
        for drone in mission.drones:
            x, y = drone.origin_m[0] - middle[0], drone.origin_m[1] - middle[1]
            place = middle[0] + cos(angle) * x - sin(angle) * y, middle[1] + sin(angle) * x + cos(angle) * y, drone.origin_m[2]
            heading = degrees((radians(drone.yaw_deg) + angle + pi) % (2.0 * pi) - pi)
            drones.append(DroneInMission(id=f"d{len(drones) + 1}", origin_m=place, yaw_deg=heading))
    return replace(mission, name=f"{mission.name} of {count} drones", drones=tuple(drones[:count]))
