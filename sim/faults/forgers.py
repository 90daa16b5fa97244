"""Attacks with messages that every agent must refuse, and with commands that are delivered a second time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

from msgspec.structs import replace

from radron.protocol.codec import as_bytes, decode_from
from radron.protocol.entries import Cone, Entry, Exposure
from radron.protocol.message import Message
from radron.protocol.messages import Action, AnyMessage, Plan, Pose
from radron.protocol.signing import Trust, sign_entries
from radron.sim.faults.agents import Forged, OldCommand
from radron.sim.faults.poisoners import Poisoners
from radron.sim.faults.schedule import Schedule
from radron.sim.geometry import Vector3

BESIDE_M = 15.0
RESUME_AFTER_NS, COPY_AFTER_NS = 3_000_000_000, 8_000_000_000  # from the hold to the resumption, and to the copy of the hold
INVALID_NUMBER_OFFSET = 2**30  # added to the number of an invalid entry, so that it hides no valid one
_SAID = ("pose", "plan", "cone", "exposure")
_TOO_LONG = 50.0  # live time, of a duration
_OTHER = "0123456789abcdef"  # id of another mission

Give = Callable[[Sequence[int], Action], bytes | None]  # drones and action -> payload sent
Again = Callable[[int, int, bytes], None]


class Forgers:
    """Makes the forged messages that attacking drones of a simulated flight send besides their own."""

    def __init__(self, schedule: Schedule, drones: Sequence[str], trusts: Sequence[Trust], poisoners: Poisoners) -> None:
        """``drones``: ids of the mission's drones. ``trusts``: signing keys of each drone, which a forger holds. ``poisoners``:
        make false exposures.
        """
        self._schedule, self._drones, self._trusts, self._poisoners = schedule, drones, trusts, poisoners

    def forged(self, drone: int, key: str, payload: bytes) -> list[bytes]:
        """Return the forged messages that a drone sends besides this message, under its key."""
        if key.rsplit("/", 1)[-1] not in _SAID:
            return []
        active = self._schedule.active(Forged, drone)
        told: list[AnyMessage | None] = [*self._poisoners.beside(drone, key, payload)]
        told += [self._changed(key, payload, fault.what, drone) for fault, _ in active]
        return [as_bytes(self._signed(one, drone)) for one in told if one is not None]

    def _signed(self, message: AnyMessage, drone: int) -> Message:
        return next(sign_entries([message], self._trusts[drone].sign)) if isinstance(message, Entry) else message

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
    """Plays the fault ``old-command``: after a hold and a resume command, a slow link delivers the hold a second time.

    The copy has equal bytes.
    """

    def __init__(self, schedule: Schedule) -> None:
        self._schedule = schedule
        self._resumes: deque[tuple[int, int]] = deque()  # time, drone
        self._copies: deque[tuple[int, int, bytes]] = deque()  # time, drone, payload of the copy

    def advance(self, now_ns: int, command: Give, again: Again) -> None:
        """Give the operator's commands that are due. ``again``: delivers an earlier command once more."""
        for one in self._schedule.begun:
            for drone in sorted(one.drones) if isinstance(one.fault, OldCommand) else ():
                payload = command([drone], Action.HOLD)
                if payload is not None:
                    self._copies.append((now_ns + COPY_AFTER_NS, drone, payload))
                self._resumes.append((now_ns + RESUME_AFTER_NS, drone))
        while self._resumes and self._resumes[0][0] <= now_ns:
            command([self._resumes.popleft()[1]], Action.RESUME)
        while self._copies and self._copies[0][0] <= now_ns:
            _, drone, payload = self._copies.popleft()
            again(now_ns, drone, payload)


def _impossible(message: AnyMessage) -> AnyMessage:
    """Return the message with contradictory numbers, each within its bounds."""
    match message:
        case Pose():
            return replace(message, quaternion=(0.0, 0.0, 0.0, 0.1))
        case Plan():
            first, *others = message.positions_m
            return replace(message, positions_m=(first, *(_moved(place, 1000.0) for place in others)))
        case Cone():
            first_order, second_order = (replace(order, axis=(1.0, 1.0, 0.0)) for order in message.orders)
            return replace(message, orders=(first_order, second_order), sequence=message.sequence + INVALID_NUMBER_OFFSET)
        case Exposure():
            return replace(
                message, live_time_s=_TOO_LONG * message.live_time_s, sequence=message.sequence + INVALID_NUMBER_OFFSET
            )
        case _:
            return message


def _beside(message: AnyMessage) -> AnyMessage:
    """Return the message with another place."""
    match message:
        case Pose():
            return replace(message, position_m=_moved(message.position_m, BESIDE_M))
        case Plan():
            return replace(message, positions_m=tuple(_moved(place, BESIDE_M) for place in message.positions_m))
        case Cone():
            return replace(message, apex_m=_moved(message.apex_m, BESIDE_M), sequence=message.sequence + INVALID_NUMBER_OFFSET)
        case Exposure():
            poses = tuple(replace(pose, position_m=_moved(pose.position_m, BESIDE_M)) for pose in message.poses)
            return replace(message, poses=poses, sequence=message.sequence + INVALID_NUMBER_OFFSET)
        case _:
            return message


def _moved(place: Vector3, by_m: float) -> Vector3:
    return place[0] + by_m, place[1], place[2]
