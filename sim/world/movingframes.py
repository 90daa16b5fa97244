"""Local frames of vehicles with different kinds of localisation: with initial errors, drift, rotation and jumps.

A vehicle's error is stored as the present position of its local frame in the world: all measurements and commands in that
frame then have the same error, as in flight. The small errors of ``radron.sim.world.localization`` are added.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, degrees, pi, sin
from typing import NamedTuple

import numpy as np

from radron.agent.config.mission import DatumConfig
from radron.sim.geometry import Array, Vector3
from radron.sim.vehicle.guidance import Reframing
from radron.sim.world.frame import LocalFrames
from radron.sim.world.gnss import Receiver
from radron.sim.world.localization import LocalizationTruth
from radron.sim.world.localizers import EventTruth, Kind, LiarTruth, SlamTruth, VehicleTruth
from radron.sim.world.streams import Streams

_FILTER_S = 1.0  # time constant with which an autopilot follows its receiver: positions do not jump with it, but slide
# Shares of its receiver's error in a vehicle's position: heights depend more on barometer and rangefinder.
_TAKEN = np.array([1.0, 1.0, 0.3])
_UPWARDS = 0.1  # share of a launch position's error: the ground is known best


class Jump(NamedTuple):
    """A jump of a vehicle's own position by (3,) metres in world axes, and of its heading.

    ``undoes``: an earlier jump is undone by the opposite angle.
    """

    shift_m: Array
    turn_rad: float = 0.0
    announced: bool = False
    undoes: bool = False


class Reset(NamedTuple):
    """An announced reset of a vehicle's filter: its position jumps by (3,) metres in world axes, as an error is removed."""

    jump_m: Array


class _Frame:
    """One vehicle's frame: position of its origin (3,) in the world, and its heading.

    true: its position without localisation error, in this epoch.
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
        self._due: list[Jump | Reset] = []
        self._moved_m: dict[float, Array] = {}  # by angle: displacement of the origin by unannounced turns about the vehicle
        spread = truth.origin_m * np.array([1.0, 1.0, _UPWARDS])
        self.true_origin: Array = np.array(origin, dtype=np.float64) + spread * rng.standard_normal(3)
        self.true_yaw = float(np.radians(yaw_deg + truth.yaw_deg * rng.uniform(-1.0, 1.0)))
        self._north_origin = self.true_origin.copy()  # of the frame by satellites, to which a switch returns
        self.origin, self.yaw = self.true_origin.copy(), self.true_yaw
        slam = truth.slam
        self._rate_sigma = np.array([slam.drift, slam.drift, slam.vertical, np.radians(slam.yaw_degpm)])
        self._rate = self._rate_sigma * rng.standard_normal(4)
        self._follow = 1.0 - float(np.exp(-step_s / _FILTER_S))
        self._closing = 0.0 if slam.closure_s is None else step_s / slam.closure_s
        self._spoofing(0.0)
        if self._steered_by_satellites and receiver is not None:
            self.origin = self._north_origin - _TAKEN * receiver.error_m
        self.reframing: Reframing | None = None

    @property
    def _steered_by_satellites(self) -> bool:
        return self.kind != "slam" and self.receiver is not None and self.receiver.available

    @property
    def told_m(self) -> float:
        """1 sigma of the horizontal distance, as the autopilot reports it."""
        return self._slam.told_m if self.kind == "slam" or self.receiver is None else self.receiver.reported_horizontal_m

    def step(self, time_s: float, place: Array, flown_m: float) -> None:
        """Advance one step; ``place`` (3,): the vehicle's position; ``flown_m``: since the last step."""
        self.reframing = None
        if self.receiver is not None:
            self.receiver.step()
        self._spoofing(time_s)
        if self._steered_by_satellites:
            assert self.receiver is not None
            self.origin += self._follow * (self._north_origin - _TAKEN * self.receiver.error_m - self.origin)
        else:
            self._drift(place, flown_m)
        while self._events and self._events[0].at_s <= time_s:
            self._happen(self._events.pop(0), place)
        for change in self._due:
            self._change(change, place)
        self._due.clear()
        if self.kind == "slam" and self._closing and self._rng.random() < self._closing:
            self._close_loop(place)

    def own_error_m(self, place: Array) -> Array:
        """(3,) world axes: position error of a vehicle at ``place`` (3,) that uses its frame of this epoch."""
        error: Array = _turned(self.true_yaw, _turned(-self.yaw, place - self.origin)) + self.true_origin - place
        return error

    def _spoofing(self, time_s: float) -> None:
        if self._liar is None or time_s < self._liar.at_s:
            return
        self._liar = None
        self.spoof(self._lie_m)

    def spoof(self, by_m: Array) -> None:
        """Shift positions and fixes alike by (3,), world axes; nothing is reported."""
        if self.receiver is not None:
            self.receiver.shift_m = self.receiver.shift_m + by_m
        if not self._steered_by_satellites:
            self.origin = self.origin - by_m

    def expect(self, change: Jump | Reset) -> None:
        """Apply a change in the next step."""
        self._due.append(change)

    def _drift(self, place: Array, flown_m: float) -> None:
        """Add the odometry drift; vehicles that only wait for their satellites keep north."""
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
        self._jump(before, Jump(shift, float(np.radians(event.turn_deg * side)), event.announced), place)
        if event.switch_to is not None and self._steered_by_satellites:
            self.true_origin, self.true_yaw = self._north_origin.copy(), 0.0

    def _change(self, change: Jump | Reset, place: Array) -> None:
        if isinstance(change, Jump):
            self._jump((self.origin, self.yaw), change, place)
            return
        x, y, z = _turned(-self.yaw, change.jump_m).tolist()
        self.reframing = Reframing(0.0, (x, y, z))
        self.epoch += 1

    def _jump(self, before: tuple[Array, float], jump: Jump, place: Array) -> None:
        """Apply a jump. ``before``: origin and heading before it."""
        origin = self.origin
        self._turn_about(place, jump.turn_rad)
        if jump.undoes:  # turned back about the place where the vehicle is now, its position would stay wrong
            self.origin = origin - self._moved_m.pop(-jump.turn_rad, 0.0)
        elif not jump.announced:
            self._moved_m[jump.turn_rad] = self._moved_m.get(jump.turn_rad, 0.0) + self.origin - origin
        if jump.turn_rad and self.kind != "slam":
            self._north_origin = self._north_origin + self.origin - origin
        self.origin = self.origin - jump.shift_m
        self._north_origin = self._north_origin - jump.shift_m
        if jump.announced:
            turn, moved = self._begin_epoch(*before)
            # An announced jump has a known size; the position error is the same as before: true' = true . old from new
            self.true_origin = self.true_origin + _turned(self.true_yaw, _turned(-turn, -moved))
            self.true_yaw -= turn

    def _switch(self, kind: Kind) -> None:
        self.kind = kind
        if self.receiver is None:
            return
        self.receiver.lost = kind == "slam"
        if self._steered_by_satellites:
            self.origin, self.yaw = self._north_origin - _TAKEN * self.receiver.error_m, 0.0

    def _close_loop(self, place: Array) -> None:
        """Close a loop: most of the drift is corrected at once, as the beginning of the map is known."""
        before, share = (self.origin, self.yaw), self._slam.closure_share
        error = self.own_error_m(place)
        self._turn_about(place, share * (self.true_yaw - self.yaw))
        self.origin = self.origin + share * error
        if self._slam.closure_announced:
            self._begin_epoch(*before)

    def _begin_epoch(self, old_origin: Array, old_yaw: float) -> tuple[float, Array]:
        """Start a new epoch. Returns ``new from old``: turn and translation (3,)."""
        turn = old_yaw - self.yaw
        moved = _turned(-self.yaw, old_origin - self.origin)
        self.reframing = Reframing(turn, (float(moved[0]), float(moved[1]), float(moved[2])))
        self.epoch += 1
        return turn, moved


class MovingFrames(LocalFrames):
    """The local frames of all vehicles, which drift and jump as their localisation errs.

    Vehicles not mentioned in the scenario stay at the launch layout. In addition to ``LocalFrames``, there are lists by vehicle:
    epoch; told_m: accuracy reported by each autopilot beyond the small errors; reframing: announced jumps of the last step;
    receiver. moving: some frames move in this scenario, without any fault.
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
        """``nominal``: for each vehicle, the origin in the world and the heading in degrees by the launch layout. ``datum``:
        place on Earth of the world's origin.
        """
        super().__init__(nominal)
        count = len(drones)
        lie_m, liar = _spoofing(truth, drones, random.liar)
        self._frames: list[_Frame | None] = [None] * count
        self._step_s, self._rngs = step_s, random.frames
        for k, name in enumerate(drones):
            vehicle = truth.vehicles.get(name)
            if vehicle is None:
                continue
            reception = vehicle.reception
            receiver = Receiver(reception, datum, step_s, random.receivers[k]) if reception is not None else None
            if receiver is not None and vehicle.receiver is None:
                receiver.lost = vehicle.kind == "slam"  # no reception until it switches
            told = truth.liar if name == liar else None
            self._frames[k] = _Frame(vehicle, nominal[k], lie_m, told, receiver, step_s, random.frames[k])
        self.moving = self._exist = any(frame is not None for frame in self._frames)
        self._place: Array | None = None
        self._take()

    @property
    def epoch(self) -> list[int]:
        """Number of announced jumps of each vehicle's localisation so far."""
        return [0 if frame is None else frame.epoch for frame in self._frames]

    @property
    def told_m(self) -> list[float]:
        """Accuracy that each autopilot reports beyond the small errors: 1 sigma of the horizontal distance, metres."""
        return [0.0 if frame is None else frame.told_m for frame in self._frames]

    @property
    def receiver(self) -> list[Receiver | None]:
        """Satellite receiver of each vehicle; None without one."""
        return [None if frame is None else frame.receiver for frame in self._frames]

    @property
    def reframing(self) -> list[Reframing | None]:
        """Announced jump of each vehicle's local frame in the last time step; None without one."""
        return [None if frame is None else frame.reframing for frame in self._frames]

    @property
    def begun_m(self) -> Array:
        """(N, 3) origins of the local frames in the world with their initial errors only, metres."""
        nominal = zip(self._frames, self.origin, strict=True)
        return np.array([origin if frame is None else frame.true_origin for frame, origin in nominal])

    def spoof(self, drone: int, by_m: Array) -> None:
        """Shift a vehicle's positions and fixes alike by (3,) metres in world axes, as by spoofed satellites.

        Nothing is reported to the agent.
        """
        self._frame(drone).spoof(by_m)

    def expect(self, drone: int, change: Jump | Reset) -> None:
        """Schedule a jump or a reset of a vehicle's localisation for the next time step."""
        self._frame(drone).expect(change)

    def flies_by_satellites(self, drone: int) -> bool:
        """Return whether a vehicle's localisation needs satellites."""
        frame = self._frames[drone]
        return frame is None or frame.kind != "slam"

    def block(self, drone: int, blocked: bool) -> None:
        """Block a vehicle's satellite reception, or restore it."""
        frame = self._frames[drone]
        if frame is not None and frame.receiver is not None:
            frame.receiver.blocked = blocked

    def step(self, time_s: float, place: Array) -> None:
        """Simulate the local frames for one time step. ``place``: (N, 3) true positions of the vehicles in the world."""
        if not self._exist:
            return
        before = place if self._place is None else self._place
        flown_m = np.sqrt(((place - before) ** 2).sum(axis=1)).tolist()
        self._place = place.copy()
        for k, frame in enumerate(self._frames):
            if frame is not None:
                frame.step(time_s, self._place[k], flown_m[k])
        self._take()

    def own_error_m(self, place: Array) -> Array:
        """Return the position error (N, 3) of each vehicle that its local frame causes at the true position ``place`` (N, 3)."""
        error = np.zeros_like(place)
        for k, frame in enumerate(self._frames):
            if frame is not None:
                error[k] = frame.own_error_m(place[k])
        return error

    def _frame(self, drone: int) -> _Frame:
        """Return the frame of a vehicle; without a mention in the scenario, a frame without drift."""
        frame = self._frames[drone]
        if frame is None:
            still = VehicleTruth(kind="gnss", slam=SlamTruth(drift=0.0, vertical=0.0, yaw_degpm=0.0, told_m=0.0))
            x, y, z = self.origin[drone].tolist()
            nominal = (x, y, z), degrees(self.yaw_rad[drone])
            frame = _Frame(still, nominal, np.zeros(3), None, None, self._step_s, self._rngs[drone])
            self._frames[drone], self._exist = frame, True
        return frame

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


def _spoofing(truth: LocalizationTruth, drones: Sequence[str], rng: np.random.Generator) -> tuple[Array, str | None]:
    """Return the spoofing offset (3,), and the drone concerned."""
    if truth.liar is None:
        return np.zeros(3), None
    liar = str(rng.choice([name for name in drones if name in truth.vehicles]))
    direction = rng.uniform(-pi, pi)
    return truth.liar.shift_m * np.array([cos(direction), sin(direction), 0.0]), liar
