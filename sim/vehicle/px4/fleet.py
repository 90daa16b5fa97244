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

import numpy as np

from sim.frame import LocalFrames
from sim.localization import Localization
from sim.vehicle.multirotor import Multirotors
from sim.vehicle.px4.config import Datum, Px4Config
from sim.vehicle.px4.estimate import Estimator
from sim.vehicle.px4.face import Px4Face

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

    Each has its own local NED frame with an origin some tens of metres from where it stands.
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
        clock_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        """``frame_yaw_rad``: heading of each vehicle's local frame in the world; none: all are right. ``clock_ns``: UTC.

        The vehicles stand where ``motion`` has them now.
        """
        count = len(configs)
        self._motion, self._error = motion, error
        self._step_s = step_s
        self._steps = 0
        offset = rng.uniform(-1.0, 1.0, (count, 3)) * ORIGIN_OFFSET_M
        yaws = np.zeros(count) if frame_yaw_rad is None else np.array(frame_yaw_rad)
        origins = motion.position_m + offset
        self._frames = LocalFrames([(origin, float(np.degrees(yaw))) for origin, yaw in zip(origins, yaws, strict=True)])
        self._estimator = Estimator(motion, error, self._frames, datum, step_s)
        self._ground_m = np.minimum(motion.position_m[:, 2], 0.0)
        headings = (motion.yaw_rad + error.yaw_error_rad - self._frames.yaw_rad).tolist()
        places = zip(configs, self._estimator.step(), headings, self._estimator.origins, strict=True)
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

    def step(self) -> None:
        """Advance by one step: estimate, modes, motion, errors; then send what is due. Never blocks."""
        self._steps += 1
        contact = (self._motion.position_m[:, 2] <= self._ground_m + CONTACT_M).tolist()
        for face, estimate, touches in zip(self.faces, self._estimator.step(), contact, strict=True):
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
        motion.rest_on(self._ground_m)
        error.step()


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
