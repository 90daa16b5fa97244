"""The local frames of vehicles that localise themselves differently: they begin anywhere, wander, turn and jump.

A vehicle's error is kept as where its local frame lies in the world at this moment: whatever the vehicle measures in that frame
and whatever it is told to do in it is then wrong alike, as in flight. The small errors of ``sim.localization`` come on top.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, pi, sin

import numpy as np
from numpy.typing import NDArray

from agent.config import DatumConfig
from sim.frame import LocalFrames, Vector3
from sim.gnss import Receiver
from sim.localization import LocalizationTruth
from sim.positioning import EventTruth, Kind, LiarTruth, VehicleTruth
from sim.streams import Streams
from sim.vehicle.guidance import Reframing

Array = NDArray[np.float64]
_FILTER_S = 1.0  # in which an autopilot's filter follows its receiver: positions do not jump with it, but slide
# What of its receiver's error gets into a vehicle's places: heights are held more by barometer and rangefinder.
_TAKEN = np.array([1.0, 1.0, 0.3])
_UPWARDS = 0.1  # of a launch place's error: the ground is known best


class _Frame:
    """Where one vehicle's frame lies: place of its origin (3,) in the world, and its heading.

    true: where it would lie had its localisation no error, in this epoch.
    """

    def __init__(
        self,
        truth: VehicleTruth,
        nominal: tuple[Vector3, float],
        lie_m: Array,
        liar: LiarTruth | None,
        receiver: Receiver | None,
        step_s: float,
        rng: np.random.Generator,
    ) -> None:
        origin, yaw_deg = nominal
        self.kind: Kind = truth.kind
        self.epoch = 0
        self.receiver = receiver
        self._slam, self._rng = truth.slam, rng
        self._events = list(truth.events)
        self._lie_m, self._liar = lie_m, liar
        spread = truth.origin_m * np.array([1.0, 1.0, _UPWARDS])
        self.true_origin: Array = np.array(origin, dtype=np.float64) + spread * rng.standard_normal(3)
        self.true_yaw = float(np.radians(yaw_deg + truth.yaw_deg * rng.uniform(-1.0, 1.0)))
        self._north_origin = self.true_origin.copy()  # of the frame by satellites, which a switch leads back to
        self.origin, self.yaw = self.true_origin.copy(), self.true_yaw
        slam = truth.slam
        self._rate_sigma = np.array([slam.drift, slam.drift, slam.vertical, np.radians(slam.yaw_degpm)])
        self._rate = self._rate_sigma * rng.standard_normal(4)
        self._follow = 1.0 - float(np.exp(-step_s / _FILTER_S))
        self._closing = 0.0 if slam.closure_s is None else step_s / slam.closure_s
        self._lie(0.0)
        if self._steered_by_satellites and receiver is not None:
            self.origin = self._north_origin - _TAKEN * receiver.error_m
        self.reframing: Reframing | None = None

    @property
    def _steered_by_satellites(self) -> bool:
        return self.kind != "slam" and self.receiver is not None and self.receiver.available

    @property
    def told_m(self) -> float:
        """1 sigma of the horizontal distance, as the autopilot tells it."""
        return self._slam.told_m if self.kind == "slam" or self.receiver is None else self.receiver.told_horizontal_m

    def step(self, time_s: float, place: Array, flown_m: float) -> None:
        """Advance one step; the vehicle (3,) has flown so far since the last one."""
        self.reframing = None
        if self.receiver is not None:
            self.receiver.step()
        self._lie(time_s)
        if self._steered_by_satellites:
            assert self.receiver is not None
            self.origin += self._follow * (self._north_origin - _TAKEN * self.receiver.error_m - self.origin)
        else:
            self._drift(place, flown_m)
        while self._events and self._events[0].at_s <= time_s:
            self._happen(self._events.pop(0), place)
        if self.kind == "slam" and self._closing and self._rng.random() < self._closing:
            self._close_loop(place)

    def own_error_m(self, place: Array) -> Array:
        """(3,) world axes: by how much the vehicle is wrong about its place (3,), which it takes by its frame of this epoch."""
        error: Array = _turned(self.true_yaw, _turned(-self.yaw, place - self.origin)) + self.true_origin - place
        return error

    def _lie(self, time_s: float) -> None:
        if self._liar is None or time_s < self._liar.at_s:
            return
        self._liar = None
        if self.receiver is not None:
            self.receiver.shift_m = self._lie_m
        if not self._steered_by_satellites:
            self.origin = self.origin - self._lie_m

    def _drift(self, place: Array, flown_m: float) -> None:
        """Odometry goes wrong as it is flown; north stays where it is for those who only wait for their satellites."""
        keep = float(np.exp(-flown_m / self._slam.along_m))
        self._rate *= keep
        self._rate += (1.0 - keep**2) ** 0.5 * self._rate_sigma * self._rng.standard_normal(4)
        if self.kind == "slam":
            self._turn_about(place, float(self._rate[3]) * flown_m)
        self.origin = self.origin - self._rate[:3] * flown_m

    def _turn_about(self, place: Array, angle: float) -> None:
        local = _turned(-self.yaw, place - self.origin)
        self.yaw += angle
        self.origin = place - _turned(self.yaw, local)

    def _happen(self, event: EventTruth, place: Array) -> None:
        before = (self.origin, self.yaw)
        if event.switch_to is not None:
            self._switch(event.switch_to)
        direction, side = self._rng.uniform(-pi, pi), self._rng.choice((-1.0, 1.0))
        shift = event.jump_m * np.array([cos(direction), sin(direction), 0.0])
        self._turn_about(place, float(np.radians(event.turn_deg * side)))
        self.origin = self.origin - shift
        self._north_origin = self._north_origin - shift
        if event.announced:
            turn, moved = self._begin_epoch(*before)
            # Whoever is told knows by how much; the place is as wrong as it was before: true' = true . old from new
            self.true_origin = self.true_origin + _turned(self.true_yaw, _turned(-turn, -moved))
            self.true_yaw -= turn
        if event.switch_to is not None and self._steered_by_satellites:
            self.true_origin, self.true_yaw = self._north_origin.copy(), 0.0

    def _switch(self, kind: Kind) -> None:
        self.kind = kind
        if self.receiver is None:
            return
        self.receiver.lost = kind == "slam"
        if self._steered_by_satellites:
            self.origin, self.yaw = self._north_origin - _TAKEN * self.receiver.error_m, 0.0

    def _close_loop(self, place: Array) -> None:
        """Most of what has drifted is taken back at once: the map's beginning is known, and it is where it was."""
        before, share = (self.origin, self.yaw), self._slam.closure_share
        error = self.own_error_m(place)
        self._turn_about(place, share * (self.true_yaw - self.yaw))
        self.origin = self.origin + share * error
        if self._slam.closure_announced:
            self._begin_epoch(*before)

    def _begin_epoch(self, old_origin: Array, old_yaw: float) -> tuple[float, Array]:
        """Returns ``new from old``: turn and translation (3,)."""
        turn = old_yaw - self.yaw
        moved = _turned(-self.yaw, old_origin - self.origin)
        self.reframing = Reframing(turn, (float(moved[0]), float(moved[1]), float(moved[2])))
        self.epoch += 1
        return turn, moved


class MovingFrames(LocalFrames):
    """The frames of all vehicles; those of which the scenario says nothing else stay where the launch layout has them.

    Beside what ``LocalFrames`` has, all by vehicle: epoch, a list; told_m: what each autopilot claims of its place beyond the
    small errors; reframing: of each whose frame jumped in the last step, and was told so; receiver.
    """

    def __init__(
        self,
        truth: LocalizationTruth,
        drones: Sequence[str],
        nominal: Sequence[tuple[Vector3, float]],
        datum: DatumConfig | None,
        step_s: float,
        random: Streams,
    ) -> None:
        """``nominal``: origin in the world and heading in degrees, as the launch layout has them. ``datum``: of the world."""
        super().__init__(nominal)
        count = len(drones)
        lie_m, liar = _lie(truth, drones, random.liar)
        self._frames: list[_Frame | None] = [None] * count
        for k, name in enumerate(drones):
            vehicle = truth.vehicles.get(name)
            if vehicle is None:
                continue
            reception = vehicle.reception
            receiver = Receiver(reception, datum, step_s, random.receivers[k]) if reception is not None else None
            if receiver is not None and vehicle.receiver is None:
                receiver.lost = vehicle.kind == "slam"  # it has none until it switches
            told = truth.liar if name == liar else None
            self._frames[k] = _Frame(vehicle, nominal[k], lie_m, told, receiver, step_s, random.frames[k])
        self.moving = any(frame is not None for frame in self._frames)
        self._place: Array | None = None
        self._take()

    @property
    def epoch(self) -> list[int]:
        """Of each vehicle's frame: how often its localisation has jumped and said so."""
        return [0 if frame is None else frame.epoch for frame in self._frames]

    @property
    def told_m(self) -> list[float]:
        """1 sigma of the horizontal distance that each autopilot claims beyond the small errors."""
        return [0.0 if frame is None else frame.told_m for frame in self._frames]

    @property
    def receiver(self) -> list[Receiver | None]:
        """Each vehicle's satellite receiver."""
        return [None if frame is None else frame.receiver for frame in self._frames]

    @property
    def reframing(self) -> list[Reframing | None]:
        """Of each vehicle whose frame jumped in the last step, and was told so."""
        return [None if frame is None else frame.reframing for frame in self._frames]

    @property
    def begun_m(self) -> Array:
        """(N, 3), world: where each frame's origin would lie if nothing was wrong with it but where it begins."""
        nominal = zip(self._frames, self.origin, strict=True)
        return np.array([origin if frame is None else frame.true_origin for frame, origin in nominal])

    def step(self, time_s: float, place: Array) -> None:
        """Advance one step: the vehicles (N, 3) are now here, in the world."""
        if not self.moving:
            return
        before = place if self._place is None else self._place
        flown_m = np.sqrt(((place - before) ** 2).sum(axis=1)).tolist()
        self._place = place.copy()
        for k, frame in enumerate(self._frames):
            if frame is not None:
                frame.step(time_s, self._place[k], flown_m[k])
        self._take()

    def own_error_m(self, place: Array) -> Array:
        """(N, 3): by how much each vehicle's frame makes it wrong about its place (N, 3) in the world."""
        error = np.zeros_like(place)
        for k, frame in enumerate(self._frames):
            if frame is not None:
                error[k] = frame.own_error_m(place[k])
        return error

    def _take(self) -> None:
        for k, frame in enumerate(self._frames):
            if frame is not None:
                self._put(k, frame.origin, frame.yaw)

    def _put(self, drone: int, origin: Array, yaw: float) -> None:
        self.origin[drone], self.yaw_rad[drone] = origin, yaw
        self.matrix[drone, :2, :2] = ((cos(yaw), -sin(yaw)), (sin(yaw), cos(yaw)))
        self._transposed[drone] = self.matrix[drone].T


def _turned(yaw: float, vector: Array) -> Array:
    c, s = cos(yaw), sin(yaw)
    x, y, z = vector.tolist()
    return np.array([c * x - s * y, s * x + c * y, z])


def _lie(truth: LocalizationTruth, drones: Sequence[str], rng: np.random.Generator) -> tuple[Array, str | None]:
    """The shift (3,) of the one that lies, and who it is."""
    if truth.liar is None:
        return np.zeros(3), None
    liar = str(rng.choice([name for name in drones if name in truth.vehicles]))
    direction = rng.uniform(-pi, pi)
    return truth.liar.shift_m * np.array([cos(direction), sin(direction), 0.0]), liar
