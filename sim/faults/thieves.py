"""Attackers with a copied key: they publish under a drone's name, beside the drone itself and at their own pace."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msgspec import UNSET
from msgspec.structs import replace

from radron.protocol.codec import as_bytes, decode_from
from radron.protocol.messages import Plan, Pose, Stage, Status
from radron.protocol.signing import Trust, sign_status
from radron.sim.faults.agents import CopiedKey
from radron.sim.faults.schedule import Active, Schedule
from radron.sim.geometry import Vector3

OTHER_BOOT = "0123456789abcdef"
_KINDS = ("pose", "plan", "status")
_STILL = (0.0, 0.0, 0.0)

News = Pose | Plan | Status


class Thieves:
    """Plays the thieves of drones' keys in a simulated flight: each overhears its drone, and publishes a changed version."""

    def __init__(self, schedule: Schedule, trusts: Sequence[Trust]) -> None:
        """``schedule``: times of the faults. ``trusts``: signing keys of each drone."""
        self._schedule, self._trusts = schedule, trusts
        self._heard: dict[int, dict[str, tuple[str, News]]] = {}  # the newest message of each drone and kind, with its key
        self._frozen: dict[tuple[Active, str], News] = {}  # at the begin of the theft
        self._due_ns: dict[Active, int] = {}

    def overhear(self, drone: int, key: str, payload: bytes) -> None:
        """Record a message of a drone whose key may be stolen."""
        kind = key.rsplit("/", 1)[-1]
        if kind in _KINDS:
            message = decode_from(key, payload)
            assert isinstance(message, News)
            self._heard.setdefault(drone, {})[kind] = key, message

    def publish(self, now_ns: int) -> Iterator[tuple[int, str, bytes]]:
        """Yield the drone, key and payload of each message that a thief publishes now."""
        for fault, one in self._schedule.active(CopiedKey):
            if now_ns < self._due_ns.get(one, 0):
                continue
            self._due_ns[one] = now_ns + round(1e9 * fault.period_s)
            for drone in sorted(one.drones):
                for key, message in self._heard.get(drone, {}).values():
                    yield drone, key, as_bytes(self._signed(self._version(fault, one, key, message, now_ns), drone))

    def _version(self, fault: CopiedKey, one: Active, key: str, message: News, now_ns: int) -> News:
        if fault.place != "beside":
            message = self._frozen.setdefault((one, key), message)
        stamp_ns = now_ns + round(1e9 * fault.lead_s)
        match message:
            case Status():
                boot = message.boot if fault.boot == "same" else OTHER_BOOT
                stage = message.stage if fault.stage is None else Stage(fault.stage)
                return replace(message, stamp_ns=stamp_ns, boot=boot, stage=stage, disowns=UNSET)
            case Plan():
                places = message.positions_m if fault.place == "beside" else message.positions_m[:1]
                told = tuple(_moved(place, fault) for place in places)
                return replace(message, stamp_ns=stamp_ns, epoch=message.epoch + fault.epochs, positions_m=told)
            case Pose():
                velocity = message.velocity_mps if fault.place == "beside" else _STILL
                return replace(
                    message,
                    stamp_ns=stamp_ns,
                    epoch=message.epoch + fault.epochs,
                    position_m=_moved(message.position_m, fault),
                    velocity_mps=velocity,
                    in_air=message.in_air and fault.place != "ground",
                )

    def _signed(self, message: News, drone: int) -> News:
        return sign_status(message, self._trusts[drone]) if isinstance(message, Status) else message


def _moved(place: Vector3, fault: CopiedKey) -> Vector3:
    x, y, z = place
    return x + fault.beside_m, y, 0.0 if fault.place == "ground" else z
