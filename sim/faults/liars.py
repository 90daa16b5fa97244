"""Drones that publish false messages: changed on the way out, under valid stamps, numbers and signatures.

The liar's own log keeps the true measurements; requests for its entries are answered with the published, false version.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Sequence
from math import cos, pi, sin

from msgspec import UNSET, UnsetType
from msgspec.structs import replace

from radron.protocol.codec import decode_from, encode
from radron.protocol.entries import Cone, Counts, Entry, Exposure, Sighting
from radron.protocol.errors import ProtocolError
from radron.protocol.messages import Alternative, AnyMessage, Plan, Pose, Stage
from radron.protocol.signing import Sign, sign_entries
from radron.sim.faults.agents import Lie
from radron.sim.faults.base import Fault
from radron.sim.faults.poisoners import Poisoners
from radron.sim.faults.schedule import Active, Schedule
from radron.sim.geometry import Vector3

KIND_OF = {
    "pose": "pose",
    "plan": "plan",
    "cone": "cone",
    "counts": "exposure",
    "sighting": "sighting",
    "stage": "pose",
    "contacts": "pose",
    "home": "pose",
    "alternative": "pose",
}
_LOST_NS = 1_000_000_000  # silence from which on a link is lost


class Liars:
    """Replaces messages of lying drones by false ones in a simulated flight."""

    def __init__(self, faults: Sequence[Fault], schedule: Schedule, signs: Sequence[Sign], poisoners: Poisoners) -> None:
        """``faults``: faults of the scenario. ``signs``: signing function of each drone, whose key a liar holds."""
        self._schedule, self._signs, self._poisoners = schedule, signs, poisoners
        lies = [fault for fault in faults if isinstance(fault, Lie)]
        self._kinds = {KIND_OF[lie.what] for lie in lies}
        self._replayed = {KIND_OF[lie.what] for lie in lies if lie.how == "replayed"}
        self._said: defaultdict[tuple[int, str], list[AnyMessage]] = defaultdict(list)
        self._told: dict[tuple[int, bytes], bytes] = {}
        self._angles: dict[Active, float] = {}  # direction of each lie, rad

    def tell(self, drone: int, key: str, payload: bytes) -> bytes:
        """Return the bytes that a drone publishes instead of this message."""
        kind, poisoned = key.rsplit("/", 1)[-1], self._poisoners.replaced(drone, key, payload)
        if poisoned is not None:
            return self._instead(drone, payload, poisoned)
        if kind not in self._kinds:
            return payload
        lies = [(lie, one) for lie, one in self._schedule.active(Lie, drone) if KIND_OF[lie.what] == kind]
        if not lies and kind not in self._replayed:
            return payload
        message = decode_from(key, payload)
        if kind in self._replayed:
            self._said[drone, kind].append(message)
        changed = message
        for lie, one in lies:
            changed = self._changed(changed, drone, lie, one)
        if changed is message:
            return payload
        return self._instead(drone, payload, changed)

    def told(self, drone: int, key: str, payload: bytes) -> bytes:
        """Return the log entry that a drone sends to an asking peer instead of this one."""
        return self._told.get((drone, payload), payload)

    def _instead(self, drone: int, payload: bytes, message: AnyMessage) -> bytes:
        """Return the false payload, and keep it for later answers."""
        try:
            told = encode(next(sign_entries([message], self._signs[drone])) if isinstance(message, Entry) else message)
        except ProtocolError:  # not representable
            return payload
        if isinstance(message, Entry):
            self._told[drone, payload] = told
        return told

    def _changed(self, message: AnyMessage, drone: int, lie: Lie, active: Active) -> AnyMessage:
        ago_ns = int(lie.ago_s * 1e9)
        if lie.how == "mistimed":
            return _moved(message, -ago_ns)
        if lie.how == "replayed":
            said = self._said[drone, KIND_OF[lie.what]]
            place = bisect_right(said, message.stamp_ns - ago_ns, key=lambda one: one.stamp_ns)
            return _renewed(said[place - 1], message) if place else message
        if active not in self._angles:
            self._angles[active] = float(active.rng.uniform(0.5 * pi, 1.5 * pi))
        return falsified(message, lie, self._angles[active])


def _moved(message: AnyMessage, by_ns: int) -> AnyMessage:
    """Return the message under another time."""
    moved = replace(message, stamp_ns=message.stamp_ns + by_ns)
    return replace(moved, end_ns=moved.end_ns + by_ns) if isinstance(moved, Exposure) else moved


def _renewed(old: AnyMessage, present: AnyMessage) -> AnyMessage:
    """Return an old message under stamp and number of the present one."""
    renewed = _moved(old, present.stamp_ns - old.stamp_ns)
    if isinstance(renewed, Entry) and isinstance(present, Entry):
        return replace(renewed, boot=present.boot, sequence=present.sequence)
    return renewed


def falsified(message: AnyMessage, lie: Lie, angle: float) -> AnyMessage:
    """Return a false version of a message.

    Positions are shifted in one direction, cones and sightings turned about the vertical, counts multiplied; or a pose gets
    another stage, home or alternative frame, or the opposite contacts. ``angle``: direction of the shift, or angle of the turn,
    radians.
    """
    shift = lie.shift_m * cos(angle), lie.shift_m * sin(angle), 0.0
    match message:
        case Pose() if lie.what == "stage":
            return replace(message, stage=Stage.LANDING)
        case Pose() if lie.what == "contacts":
            silences_ns = {name: 10 * _LOST_NS if for_ns <= _LOST_NS else 0 for name, for_ns in message.silences_ns.items()}
            return replace(message, silences_ns=silences_ns)
        case Pose() if lie.what == "home":
            return replace(message, home_m=UNSET if isinstance(message.home_m, UnsetType) else _sum(message.home_m, shift))
        case Pose() if lie.what == "alternative":
            return replace(message, alternative=Alternative(shift, angle))
        case Pose():
            return replace(message, position_m=_sum(message.position_m, shift))
        case Plan():
            return replace(message, positions_m=tuple(_sum(place, shift) for place in message.positions_m))
        case Cone():
            first, second = (replace(order, axis=_turned(order.axis, angle)) for order in message.orders)
            return replace(message, orders=(first, second))
        case Exposure():
            counts = message.counts
            more = [round(lie.factor * number) for number in (counts.hits, counts.photopeak, counts.coincidences)]
            return replace(message, counts=Counts(*more))
        case Sighting():
            direction = None if message.direction is None else _turned(message.direction, angle)
            range_m = None if message.range_m is None else message.range_m + lie.shift_m
            return replace(message, direction=direction, range_m=range_m)
        case _:
            return message


def _sum(one: Vector3, other: Vector3) -> Vector3:
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]


def _turned(vector: Vector3, angle: float) -> Vector3:
    x, y, z = vector
    return cos(angle) * x - sin(angle) * y, sin(angle) * x + cos(angle) * y, z
