"""N emulated vehicles, stepped together: the interface of the world process.

fleet = Px4Fleet(configs, motion, error, STEP_S, rng)     # Multirotors and Localization as in lockstep, made for STEP_S
await fleet.start()                                       # opens the sockets on the running loop
every STEP_S (0.01 s): fleet.step()                       # moves everything by one step and sends the messages due
fleet.reports()                                           # what the observer wants to know of each vehicle
fleet.close()
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import degrees, hypot

import numpy as np

from sim.frame import LocalFrames
from sim.localization import Localization
from sim.movingframes import MovingFrames
from sim.terrain import FLAT, Terrain
from sim.vehicle.multirotor import Multirotors
from sim.vehicle.px4.config import Datum, Px4Config
from sim.vehicle.px4.estimate import Array, Estimate, Estimator
from sim.vehicle.px4.face import Px4Face
from sim.vehicle.px4.frames import AutopilotFrames
from sim.vehicle.px4.parameters import Parameters
from sim.vehicle.px4.satellites import Satellites

ORIGIN_OFFSET_M = (40.0, 40.0, 3.0)  # at most, of a local frame's origin from where the vehicle starts
CONTACT_M = 0.02


@dataclass(frozen=True, slots=True)
class VehicleReport:
    """What an observer sees of one vehicle, beside its true motion."""

    mode: str
    armed: bool
    in_air: bool
    failsafe: bool
    setpoints: int  # position targets received
    computed_setpoints: int  # of them those that say something else than the one before
    largest_gap_s: float  # between two computed setpoints while in offboard


class Px4Fleet:
    """The vehicles 0 .. N-1, MAVLink system ids 1 .. N.

    Each has its own local NED frame with an origin some tens of metres from where it stands; one that takes vision has the
    vision's. Where its localisation wanders or jumps (``localized``), this frame does.
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
        """The vehicles stand where ``motion`` has them now.

        Args:
            configs, motion, error: of each vehicle; ``motion`` and ``error`` made for steps of ``step_s``.
            step_s: time step.
            rng: for what else is drawn.
            datum: where the world's origin lies on Earth.
            frame_yaw_rad: heading of each vehicle's local frame in the world; none: all are right.
            localized: where each vehicle's localisation has its frame, instead; this fleet steps it.
            terrain: what they fly over and stand on.
            clock_ns: UTC.
        """
        count = len(configs)
        self._motion, self._error, self._localized = motion, error, localized
        self._step_s = step_s
        self._steps = 0
        self._went_s: float | None = None
        offset = rng.uniform(-1.0, 1.0, (count, 3)) * ORIGIN_OFFSET_M
        frames = localized or _standing(motion, frame_yaw_rad)
        beside = np.array(frames.local(motion.position_m + offset))
        beside[[Parameters(1, config.parameters)["EKF2_EV_CTRL"] != 0.0 for config in configs]] = 0.0
        self._frames = AutopilotFrames(frames, -beside)
        self._satellites = Satellites(localized, count)
        self._estimator = Estimator(motion, error, self._frames, datum, step_s, terrain)
        self._terrain = terrain
        self._even_m = np.minimum(motion.position_m[:, 2], 0.0)  # where the ground is even, they may stand lower than it
        places = zip(configs, self._estimator.step(), self._headings(), self._estimator.origins, strict=True)
        self.faces = [
            Px4Face(index, config, place, yaw, origin, error.position_sigma_m, step_s, rng, clock_ns)
            for index, (config, place, yaw, origin) in enumerate(places)
        ]

    async def start(self) -> None:
        """Open the links on the running loop.

        Raises:
            VehicleError: a companion's host name that cannot be resolved.
        """
        for face in self.faces:
            await face.start()

    def begin(self) -> None:
        """The mission begins: what is to happen to a localisation so long after its start is counted from now on."""
        self._went_s = self.time_s

    def step(self) -> None:
        """Advance by one step: estimate, modes, motion, errors; then send what is due. Never blocks."""
        self._steps += 1
        contact = (self._motion.position_m[:, 2] <= self._ground_m() + CONTACT_M).tolist()
        estimates = self._estimator.step()
        self._localize(estimates)
        for face, estimate, touches in zip(self.faces, estimates, contact, strict=True):
            face.step(self.time_s, estimate, touches)
        self._move()
        for face in self.faces:
            face.send_due()

    @property
    def time_s(self) -> float:
        """Simulated seconds since the start: the vehicles' boot time."""
        return self._steps * self._step_s

    def reports(self) -> list[VehicleReport]:
        """One for each vehicle."""
        return [_report(face) for face in self.faces]

    def close(self) -> None:
        """Close the links."""
        for face in self.faces:
            face.close()

    def _ground_m(self) -> Array:
        """(N,): world z of the ground below each."""
        if self._terrain.flat:
            return self._even_m
        places = self._motion.position_m
        return self._terrain.heights_m(places[:, 0], places[:, 1])

    def _move(self) -> None:
        motion, error = self._motion, self._error
        targets = [face.target for face in self.faces]
        asked = np.array([target.position for target in targets])
        free = np.isnan(asked)  # along these axes only the velocity counts; horizontally both or none
        free[:, :2] = free[:, :2].any(axis=1, keepdims=True)
        # The autopilot steers its estimate, not its true position; where it has no position to go to, it is where it should be.
        here = np.array(self._frames.local(motion.position_m + error.position_error_m))
        turned = self._frames.turn_out(
            [(tuple(position), target.velocity) for position, target in zip(np.where(free, here, asked), targets, strict=True)]
        )
        position_sp = turned[:, 0] + self._frames.origin - error.position_error_m
        yaw_sp = np.array([target.yaw for target in targets]) + self._frames.yaw_rad - error.yaw_error_rad
        grounded = np.array([face.grounded for face in self.faces])
        motion.step(position_sp, turned[:, 1], yaw_sp, grounded, free if free.any() else None)
        motion.rest_on(self._ground_m())
        error.step()
        self._move_frames()

    def _headings(self) -> list[float]:
        """Of each vehicle in its own frame, ENU, as it takes it to be."""
        headings: list[float] = (self._motion.yaw_rad + self._error.yaw_error_rad - self._frames.yaw_rad).tolist()
        return headings

    def _localize(self, estimates: Sequence[Estimate]) -> None:
        """What satellites and vision say; by vision, an estimate is another one from the next step on."""
        places = self._motion.position_m
        for drone, (face, estimate, yaw) in enumerate(zip(self.faces, estimates, self._headings(), strict=True)):
            self._satellites.tell(drone, face, places[drone], estimate.place)
            corrections = face.look(self.time_s, estimate, yaw, self._step_s)
            by_vision = self._is_by_vision(drone)
            for shift_m, turn_rad, reset in corrections if by_vision else ():
                reframing = self._frames.correct(drone, places[drone] + self._error.position_error_m[drone], shift_m, turn_rad)
                if reset:
                    face.reset(reframing)
            face.be_guided(by_vision)

    def _is_by_vision(self, drone: int) -> bool:
        face = self.faces[drone]
        return face.vision.wanted and not (face.by_satellites and self._satellites.hopeful(drone))

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
    """Frames that begin where the vehicles stand, and stay."""
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
