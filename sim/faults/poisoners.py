"""Drones that poison the log: they publish signed photon counts with chosen places and numbers."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count
from math import cos, pi, radians, sin

from msgspec.structs import replace

from radron.protocol.codec import decode_from
from radron.protocol.entries import Counts, Exposure, PoseSample
from radron.protocol.messages import Estimate, Frame
from radron.sim.faults.agents import Poisoned
from radron.sim.faults.schedule import Active, Schedule
from radron.sim.geometry import Vector3

BURST_NUMBER_OFFSET = 2**29  # added to the numbers of exposures beside the drone's own
ELSEWHERE_M = 15.0
_COUNTS = {"none": Counts(0, 0, 0), "many": Counts(100_000, 40_000, 5_000)}
_APART_NS = 1_000_000  # between the ends of the exposures of a burst


class Poisoners:
    """Makes the false exposures (photon counts) that poisoning drones publish, from the source estimates that they know."""

    def __init__(self, schedule: Schedule, layout: Sequence[tuple[Vector3, float]]) -> None:
        """``layout``: launch place (mission frame, m) and heading (degrees) of each drone with an exactly known frame."""
        self._schedule, self._layout = schedule, layout
        self._estimates: dict[int, Vector3] = {}  # by drone, its newest published estimate, mission frame
        self._frames: dict[tuple[int, int], tuple[Vector3, float]] = {}  # by drone and epoch: translation, heading in radians
        self._angles: dict[Active, float] = {}
        self._numbers = count(BURST_NUMBER_OFFSET)

    def replaced(self, drone: int, key: str, payload: bytes) -> Exposure | None:
        """Return the false exposure that replaces a drone's own; None if there is none."""
        self._listen(drone, key, payload)
        faults = [(fault, one) for fault, one in self._schedule.active(Poisoned, drone) if not fault.beside]
        if not faults or not key.endswith("/exposure"):
            return None
        fault, one = faults[0]
        own = _exposure(key, payload)
        return self._poisoned(own, drone, fault, one, own.end_ns - own.stamp_ns, 0)

    def beside(self, drone: int, key: str, payload: bytes) -> list[Exposure]:
        """Return the false exposures that a drone publishes beside its own."""
        faults = [(fault, one) for fault, one in self._schedule.active(Poisoned, drone) if fault.beside]
        if not faults or not key.endswith("/exposure"):
            return []
        own = _exposure(key, payload)
        return [
            replace(
                self._poisoned(own, drone, fault, one, round(fault.lasts_s * 1e9), number * _APART_NS),
                sequence=next(self._numbers),
            )
            for fault, one in faults
            for number in range(fault.burst)
        ]

    def _listen(self, drone: int, key: str, payload: bytes) -> None:
        if key.endswith(("/estimate", "/frame")) and self._schedule.active(Poisoned, drone):
            message = decode_from(key, payload)
            if isinstance(message, Estimate) and message.sources:
                self._estimates[drone] = message.sources[0].position_m
            elif isinstance(message, Frame):
                self._frames[drone, message.epoch] = message.translation_m, message.yaw_rad

    def _poisoned(self, own: Exposure, drone: int, fault: Poisoned, one: Active, lasts_ns: int, ago_ns: int) -> Exposure:
        end_ns = own.end_ns - ago_ns
        place = self._place(own, drone, fault, one)
        return replace(
            own,
            stamp_ns=end_ns - lasts_ns,
            end_ns=end_ns,
            live_time_s=lasts_ns * 1e-9,
            counts=_COUNTS[fault.counts],
            poses=(PoseSample(0, place, own.poses[0].quaternion),),
            position_sigma_m=0.0,
            clock_sigma_m=0.0,
            spectrum=(),
        )

    def _place(self, own: Exposure, drone: int, fault: Poisoned, one: Active) -> Vector3:
        """Return the place of a poisoned exposure, local frame, m: on the ground at the estimate, or beside it; without an
        estimate, below the drone.
        """
        x, y, _ = own.poses[0].position_m
        told, (origin_m, yaw_deg) = self._estimates.get(drone), self._layout[drone]
        if told is not None:
            origin_m, yaw_rad = self._frames.get((drone, own.epoch), (origin_m, radians(yaw_deg)))
            east, north = told[0] - origin_m[0], told[1] - origin_m[1]
            x, y = cos(yaw_rad) * east + sin(yaw_rad) * north, cos(yaw_rad) * north - sin(yaw_rad) * east
        if fault.place == "elsewhere":
            if one not in self._angles:
                self._angles[one] = float(one.rng.uniform(0.0, 2.0 * pi))
            x, y = x + ELSEWHERE_M * cos(self._angles[one]), y + ELSEWHERE_M * sin(self._angles[one])
        return x, y, 0.0


def _exposure(key: str, payload: bytes) -> Exposure:
    message = decode_from(key, payload)
    assert isinstance(message, Exposure)
    return message
