"""Messages that every agent must refuse, sent by members beside their own; and commands that arrive again late."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import msgspec
from msgspec.structs import replace

from protocol.codec import decode_from
from protocol.entries import Cone, Entry, Exposure
from protocol.messages import Action, AnyMessage, Plan, Pose
from sim.faults.agents import Forged, OldCommand
from sim.faults.schedule import Schedule
from sim.geometry import Vector3

BESIDE_M = 15.0
HELD_NS, LATE_NS = 3_000_000_000, 8_000_000_000  # from the hold to the resumption, and to its copy
_SAID = ("pose", "plan", "cone", "exposure")
_TOO_LONG = 50.0  # live time, of a duration
_OTHER = "0123456789abcdef"  # id of another mission
_WRITER = msgspec.msgpack.Encoder()  # writes what the codec refuses


class Forgers:
    """What the drones of a flight send beside their messages."""

    def __init__(self, schedule: Schedule, drones: Sequence[str]) -> None:
        """``drones``: of the mission."""
        self._schedule, self._drones = schedule, drones

    def forged(self, drone: int, key: str, payload: bytes) -> list[bytes]:
        """What a drone sends beside this message, under the same key."""
        if key.rsplit("/", 1)[-1] not in _SAID:
            return []
        active = self._schedule.active(Forged, drone)
        return [
            _WRITER.encode(told) for fault, _ in active if (told := self._changed(key, payload, fault.what, drone)) is not None
        ]

    def _changed(self, key: str, payload: bytes, what: str, drone: int) -> AnyMessage | None:
        message = decode_from(key, payload)
        if what == "impossible":
            return _impossible(message)
        if what == "impersonated":
            other = self._drones[(drone + 1) % len(self._drones)]
            return replace(_beside(message), drone=other)
        if not isinstance(message, Entry):
            return None
        if what == "other-mission":
            return replace(_beside(message), mission=_OTHER)
        return replace(message, yaw_sigma_rad=1.001 * message.yaw_sigma_rad + 1e-6) if isinstance(message, Cone) else None


class OldCommands:
    """The operator's commands of ``old-command``, each with the stamp of its first copy."""

    def __init__(self, schedule: Schedule) -> None:
        self._schedule = schedule
        self._waiting: deque[tuple[int, int, Action, int]] = deque()  # when, to whom, what, its stamp

    def due(self, now_ns: int) -> list[tuple[int, Action, int]]:
        """The commands that arrive now: drone, command, stamp."""
        for one in self._schedule.begun:
            if isinstance(one.fault, OldCommand):
                for drone in sorted(one.drones):
                    self._waiting.append((now_ns, drone, Action.HOLD, now_ns))
                    self._waiting.append((now_ns + HELD_NS, drone, Action.RESUME, now_ns + HELD_NS))
                    self._waiting.append((now_ns + LATE_NS, drone, Action.HOLD, now_ns))
        due = [(drone, action, stamp_ns) for at_ns, drone, action, stamp_ns in self._waiting if at_ns <= now_ns]
        self._waiting = deque(one for one in self._waiting if one[0] > now_ns)
        return due


def _impossible(message: AnyMessage) -> AnyMessage:
    """Each number is within its bounds, but they contradict each other."""
    match message:
        case Pose():
            return replace(message, quaternion=(0.0, 0.0, 0.0, 0.1))
        case Plan():
            first, *others = message.positions_m
            return replace(message, positions_m=(first, *(_moved(place, 1000.0) for place in others)))
        case Cone():
            first_order, second_order = (replace(order, axis=(1.0, 1.0, 0.0)) for order in message.orders)
            return replace(message, orders=(first_order, second_order), boot=_OTHER)
        case Exposure():
            return replace(message, live_time_s=_TOO_LONG * message.live_time_s, boot=_OTHER)
        case _:
            return message


def _beside(message: AnyMessage) -> AnyMessage:
    """The same, as if it had been somewhere else."""
    match message:
        case Pose():
            return replace(message, position_m=_moved(message.position_m, BESIDE_M))
        case Plan():
            return replace(message, positions_m=tuple(_moved(place, BESIDE_M) for place in message.positions_m))
        case Cone():
            return replace(message, apex_m=_moved(message.apex_m, BESIDE_M), boot=_OTHER)
        case Exposure():
            poses = tuple(replace(pose, position_m=_moved(pose.position_m, BESIDE_M)) for pose in message.poses)
            return replace(message, poses=poses, boot=_OTHER)
        case _:
            return message


def _moved(place: Vector3, by_m: float) -> Vector3:
    return place[0] + by_m, place[1], place[2]
