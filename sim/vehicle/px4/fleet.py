"""N emulated vehicles, stepped together: the interface to the world process.

fleet = Px4Fleet(configs, motion, error, STEP_S, rng)     # Multirotors and Localization as in lockstep, made for STEP_S
await fleet.start()                                       # opens the sockets on the running loop
    every STEP_S (0.01 s): fleet.step()                   # advances everything by one step and sends the messages that are due
    fleet.reports()                                       # what an observer sees of each vehicle
fleet.close()
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import degrees, hypot
from typing import Literal

import numpy as np

from radron.sim.geometry import Array, Vector3
from radron.sim.vehicle.guidance import REST, Reframing
from radron.sim.vehicle.multirotor import Multirotors
from radron.sim.vehicle.px4.config import Datum, Px4Config
from radron.sim.vehicle.px4.face import Px4Face
from radron.sim.vehicle.px4.faults import EmulatedFaults, VehicleFault
from radron.sim.vehicle.px4.filter.deadreckoning import FilterErrors
from radron.sim.vehicle.px4.filter.estimate import Estimate, Estimator
from radron.sim.vehicle.px4.filter.frames import AutopilotFrames
from radron.sim.vehicle.px4.filter.satellites import SATELLITES, Satellites
from radron.sim.vehicle.px4.gains import equipped
from radron.sim.vehicle.px4.modes import Mode
from radron.sim.vehicle.px4.parameters import Parameters
from radron.sim.vehicle.setpoints import in_world
from radron.sim.world.frame import LocalFrames
from radron.sim.world.localization import Localization
from radron.sim.world.movingframes import MovingFrames
from radron.sim.world.terrain import FLAT, Terrain

ORIGIN_OFFSET_M = (40.0, 40.0, 3.0)  # largest offset of a local frame's origin from the vehicle's start
CONTACT_M = 0.02


@dataclass(frozen=True, slots=True)
class VehicleReport:
    """What an observer sees of one vehicle, besides its true motion."""

    mode: str
    armed: bool
    in_air: bool
    failsafe: bool
    setpoints: int  # position targets received
    computed_setpoints: int  # targets that differ from the one before
    largest_gap_s: float  # between two computed setpoints while in offboard
    # source of its position: this simulation, PX4's simulation, or its own estimate
    truth: Literal["world", "simulation", "estimate"] = "world"


class Px4Fleet:
    """Emulates N PX4 vehicles with the MAVLink system ids 1 to N, and moves them.

    Each has its own local NED frame with an origin some tens of metres from its start; with vision, the frame is the vision's.
    Drift and jumps of its localisation (``localized``) move this frame too.
    """

    def __init__(
        self,
        configs: Sequence[Px4Config],
        motion: Multirotors,
        error: Localization,
        step_s: float,
        rng: np.random.Generator,
        *,
        datum: Datum = Datum(),  # noqa: B008 - frozen
        frame_yaw_rad: Sequence[float] | None = None,
        localized: MovingFrames | None = None,
        terrain: Terrain = FLAT,
        clock_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        """Start with the vehicles standing where ``motion`` has them now.

        Args:
            configs: configuration of each vehicle.
            motion, error: true motion and localisation errors of all vehicles, made for steps of ``step_s``.
            step_s: time step.
            rng: random numbers for everything else.
            datum: the world's origin on Earth.
            frame_yaw_rad: heading of each vehicle's local frame in the world; None: all are correct.
            localized: frames of the vehicles' localisation, instead; stepped by this fleet.
            terrain: the ground below the vehicles.
            clock_ns: returns the time, nanoseconds UTC.
        """
        count = len(configs)
        self._motion, self._error, self._localized = motion, FilterErrors(error, step_s), localized
        self._step_s = step_s
        self._steps = 0
        self._went_s: float | None = None
        offset = rng.uniform(-1.0, 1.0, (count, 3)) * ORIGIN_OFFSET_M
        frames = localized or _standing(motion, frame_yaw_rad)
        beside = np.array(frames.local(motion.position_m + offset))
        beside[[Parameters(1, config.parameters)["EKF2_EV_CTRL"] != 0.0 for config in configs]] = 0.0
        self._frames = AutopilotFrames(frames, -beside)
        self._satellites = Satellites(localized, count)
        self._estimator = Estimator(motion, self._error, self._frames, datum, step_s, terrain)
        self._terrain = terrain
        self._even_m = np.minimum(motion.position_m[:, 2], 0.0)  # on level ground they may stand below it
        places = zip(configs, self._estimator.step(), self._headings(), self._estimator.origins, strict=True)
        self.faces = [
            Px4Face(index, config, place, yaw, origin, error.position_sigma_m, step_s, rng, clock_ns)
            for index, (config, place, yaw, origin) in enumerate(places)
        ]
        for drone, face in enumerate(self.faces):
            face.set_truth_source(partial(self._estimator.truth, drone))
        self._faults = EmulatedFaults(self.faces, motion, self._reset_filter, self._turn_heading, step_s, rng.spawn(1)[0])
        self._equipped = [-1] * count  # count of parameter changes that each is equipped with

    async def start(self) -> None:
        """Open the links in the running event loop.

        Raises:
            VehicleError: a companion's host name that cannot be resolved.
        """
        for face in self.faces:
            await face.start()

    def begin(self) -> None:
        """Mark the start of the mission: times of localisation events count from now."""
        self._went_s = self.time_s

    def step(self) -> None:
        """Emulate all vehicles for one time step (estimate, modes, motion, errors), then send the messages that are due.

        The call never blocks.
        """
        self._steps += 1
        contact = (self._motion.position_m[:, 2] <= self._ground_m() + CONTACT_M).tolist()
        estimates = self._estimator.step()
        self._localize(estimates)
        self._faults.step()
        for face, estimate, touches in zip(self.faces, estimates, contact, strict=True):
            face.step(self.time_s, estimate, touches)
        self._move()
        for face in self.faces:
            face.send_due()

    @property
    def time_s(self) -> float:
        """Simulated seconds since the start, which is the vehicles' boot time."""
        return self._steps * self._step_s

    def switch_satellites(self, drone: int, received: bool) -> None:
        """Switch a vehicle's satellite reception, by the parameter of PX4's simulated receiver."""
        number = np.array(SATELLITES if received else 0, dtype=np.int32)
        self.faces[drone].parameters.set("SIM_GPS_USED", float(number.view(np.float32)))

    def take_over(self, drone: int, mode: str) -> None:
        """Override a vehicle as a safety pilot does by remote control. ``mode``: ``manual``, ``hold``, ``return`` or ``land``."""
        commander = self.faces[drone].commander
        if mode == "manual":
            commander.take_over()
        else:
            commander.set_mode(Mode[mode.upper()])

    def begin_fault(self, drone: int, fault: VehicleFault) -> None:
        """Begin a fault of a vehicle, such as a gust or a failed motor."""
        self._faults.begin(drone, fault)

    def end_fault(self, drone: int, fault: VehicleFault) -> None:
        """End a fault of a vehicle that has been begun."""
        self._faults.end(drone, fault)

    def reports(self) -> list[VehicleReport]:
        """Return what an observer sees of each vehicle."""
        return [_report(face) for face in self.faces]

    def close(self) -> None:
        """Close the links of all vehicles."""
        for face in self.faces:
            face.close()

    def _reset_filter(self, drone: int, shift_m: Vector3, turn_rad: float) -> None:
        """Reset a vehicle's filter: its own position jumps by ``shift_m`` (world), its heading by ``turn_rad``."""
        place = self._motion.position_m[drone] + self._error.position_error_m[drone]
        x, y, z = (self._frames.matrix[drone].T @ np.array(shift_m)).tolist()
        self.faces[drone].reset(self._frames.correct(drone, place, (x, y, z), turn_rad))

    def _turn_heading(self, drone: int, turn_rad: float) -> None:
        """Reset the heading of a vehicle's filter by ``turn_rad``, and nothing else: its local frame stays."""
        self._error.turn(drone, turn_rad)
        self.faces[drone].reset(Reframing(0.0, REST))

    def _ground_m(self) -> Array:
        """World z (N,) of the ground below each vehicle."""
        if self._terrain.flat:
            return self._even_m
        places = self._motion.position_m
        return self._terrain.heights_m(places[:, 0], places[:, 1])

    def _equip(self) -> None:
        """Apply the vehicles' present parameters."""
        for drone, face in enumerate(self.faces):
            if self._equipped[drone] != face.parameters.changes:
                self._equipped[drone] = face.parameters.changes
                self._motion.equip(drone, equipped(self._motion.vehicle(drone), face.parameters))

    def _move(self) -> None:
        self._equip()
        motion, error = self._motion, self._error
        targets = [face.target for face in self.faces]
        asked = np.array([target.position for target in targets])
        free = np.isnan(asked)  # axes with velocity control only; horizontally both or none
        free[:, :2] = free[:, :2].any(axis=1, keepdims=True)
        places = np.where(free, 0.0, asked).tolist()
        setpoints = in_world(targets, places, self._frames, error.yaw_error_rad)
        grounded = np.array([face.grounded for face in self.faces])
        # The autopilot controls its estimates, not its true position and velocity.
        motion.step(setpoints, grounded, error.position_error_m, error.velocity_error_mps, free if free.any() else None)
        motion.rest_on(self._ground_m())
        error.step()
        self._move_frames()

    def _headings(self) -> list[float]:
        """Heading of each vehicle in its own frame, ENU, by its own estimate."""
        headings: list[float] = (self._motion.yaw_rad + self._error.yaw_error_rad - self._frames.yaw_rad).tolist()
        return headings

    def _localize(self, estimates: Sequence[Estimate]) -> None:
        """Apply satellites and vision; vision changes an estimate from the next step on."""
        places = self._motion.position_m
        for drone, (face, estimate, yaw) in enumerate(zip(self.faces, estimates, self._headings(), strict=True)):
            self._satellites.tell(drone, face, places[drone], estimate.place)
            corrections = face.look(self.time_s, estimate, yaw, self._step_s)
            by_vision = self._is_by_vision(drone)
            for shift_m, turn_rad, reset in corrections if by_vision else ():
                reframing = self._frames.correct(drone, places[drone] + self._error.position_error_m[drone], shift_m, turn_rad)
                if reset:
                    face.reset(reframing)
            self._reckon(drone, face, by_vision)
            turned_rad = face.align_heading()
            if turned_rad is not None:
                self._turn_heading(drone, turned_rad)
            face.update_position_known(by_vision)

    def _reckon(self, drone: int, face: Px4Face, by_vision: bool) -> None:
        """Apply satellites, their loss, or an external position to the next estimate."""
        told, origin = face.take_external_places()
        if told is not None:
            face.reckoning.accept_place(self._estimator.world_from(drone, told), self._motion.position_m[drone])
        jump = face.reckon(by_vision)
        self._error.take(drone, face.reckoning)
        if jump is not None:
            x, y, z = (self._frames.matrix[drone].T @ jump).tolist()
            face.reset(Reframing(0.0, (x, y, z)), 0)  # it has counted the reset itself
        if origin is not None:
            moved_m = self._estimator.move_origin(drone, origin)
            face.move_origin(origin, self._frames.move(drone, moved_m))

    def _is_by_vision(self, drone: int) -> bool:
        face = self.faces[drone]
        return face.vision.wanted and not (face.by_satellites and self._satellites.may_regain(drone))

    def _move_frames(self) -> None:
        localized = self._localized
        if localized is None:
            return
        localized.step(0.0 if self._went_s is None else self.time_s - self._went_s, self._motion.position_m)
        for face, told_m in zip(self.faces, localized.told_m, strict=True):
            face.claim(hypot(self._error.position_sigma_m[0], told_m))
        for drone, reframing in enumerate(localized.reframing):
            if self._is_by_vision(drone):
                continue
            self._frames.follow(drone)
            if reframing is not None:
                self.faces[drone].reset(self._frames.beside(drone, reframing))


def _standing(motion: Multirotors, yaw_rad: Sequence[float] | None) -> LocalFrames:
    """Fixed frames that begin where the vehicles stand."""
    yaws = [0.0] * len(motion.position_m) if yaw_rad is None else list(yaw_rad)
    return LocalFrames([(tuple(place), degrees(yaw)) for place, yaw in zip(motion.position_m.tolist(), yaws, strict=True)])


def _report(face: Px4Face) -> VehicleReport:
    commander, setpoints = face.commander, face.setpoints
    return VehicleReport(
        mode=commander.mode.name.lower(),
        armed=commander.armed,
        in_air=not commander.landed,
        failsafe=commander.fallback.active,
        setpoints=setpoints.received,
        computed_setpoints=setpoints.computed,
        largest_gap_s=setpoints.largest_gap_s,
    )
