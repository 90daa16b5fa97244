"""Faults of emulated vehicles in live flights.

They are gusts, a failed motor, a low or misreported battery, refusals, position jumps, heading resets, silence, and disarming.
They correspond to ``radron.sim.faults.vehicles`` in lockstep, except for the emulation's own behaviour: its failsafes react to
the battery.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import cos, pi, radians, sin

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from radron.sim.faults.machines import (
    EMPTY_MPS,
    Battery,
    Disarm,
    Gust,
    HeadingReset,
    MotorFailure,
    PositionJump,
    Refusal,
    StreamLost,
)
from radron.sim.geometry import Array, Vector3
from radron.sim.vehicle.multirotor import Multirotors
from radron.sim.vehicle.px4.battery import Battery as Cells
from radron.sim.vehicle.px4.face import Px4Face

VehicleFault = Gust | MotorFailure | Battery | Refusal | StreamLost | PositionJump | HeadingReset | Disarm
ResetFilter = Callable[[int, Vector3, float], None]
TurnHeading = Callable[[int, float], None]
_ACTION = "COM_LOW_BAT_ACT"
_ONLY_WARN = 0.0  # as on the link, where an integer is sent as its bits


class EmulatedFaults:
    """Plays the faults of all emulated vehicles of a live flight."""

    def __init__(
        self,
        faces: Sequence[Px4Face],
        motion: Multirotors,
        reset: ResetFilter,
        turn: TurnHeading,
        step_s: float,
        rng: np.random.Generator,
    ) -> None:
        """``reset``: resets a vehicle's filter: its own position jumps by a shift (world, m) and its heading by an angle
        (rad); ``turn``: resets its heading alone, by an angle (rad); ``rng``: draws the directions of gusts and jumps.
        """
        self._faces, self._motion, self._reset, self._turn = faces, motion, reset, turn
        self._step_s, self._rng = step_s, rng
        self._active: list[tuple[int, VehicleFault]] = []
        self._pushes: dict[tuple[int, VehicleFault], Array] = {}
        self._jumps: dict[tuple[int, VehicleFault], tuple[Array, float]] = {}  # shift, angle
        self._true: dict[int, Cells] = {}  # of vehicles with a misreported battery
        self._actions: dict[int, float] = {}  # of vehicles whose autopilot only warns for now

    def begin(self, drone: int, fault: VehicleFault) -> None:
        """Begin a fault of a vehicle."""
        self._active.append((drone, fault))
        match fault:
            case Gust():
                self._pushes[drone, fault] = fault.acceleration_mps2 * self._direction()
                self._push(drone)
            case MotorFailure():
                self._fail(drone, fault.descent_mps)
            case Battery():
                self._drain(drone, fault)
            case Refusal():
                self._faces[drone].refuses = True
            case StreamLost():
                self._mute(drone, fault.message, muted=True)
            case PositionJump():
                turn_rad = self._side() * radians(fault.turn_deg)
                self._jumps[drone, fault] = fault.jump_m * self._direction(), turn_rad
                self._jump(drone, *self._jumps[drone, fault])
            case HeadingReset():
                if self._faces[drone].by_satellites:
                    self._turn(drone, self._side() * radians(fault.turn_deg))
            case Disarm():
                self._faces[drone].disarm_before_takeoff()

    def end(self, drone: int, fault: VehicleFault) -> None:
        """End a fault of a vehicle."""
        self._active.remove((drone, fault))
        match fault:
            case Gust():
                self._pushes.pop((drone, fault), None)
                self._push(drone)
            case Refusal():
                self._faces[drone].refuses = any(isinstance(other, Refusal) for one, other in self._active if one == drone)
            case Battery() if not self._batteries(drone):
                self._mend_battery(drone)
            case StreamLost() if not self._is_lost(drone, fault.message):
                self._mute(drone, fault.message, muted=False)
            case PositionJump():
                shift_m, turn_rad = self._jumps.pop((drone, fault))
                self._jump(drone, -shift_m, -turn_rad)

    def step(self) -> None:
        """Discharge batteries for one time step, as faults demand."""
        for drone, fault in self._active:
            if not isinstance(fault, Battery):
                continue
            face, true = self._faces[drone], self._battery(drone)
            cells = face.battery if fault.lies else true
            flying = not face.grounded
            cells.used_mah = min(cells.capacity_mah, cells.used_mah + fault.drain_ps * self._step_s * cells.capacity_mah * flying)
            if true is not face.battery:
                true.step(face.commander.armed, flying)
            if flying and true.remaining <= 0.0:
                self._fail(drone, EMPTY_MPS)

    def _battery(self, drone: int) -> Cells:
        """Return the vehicle's true battery."""
        return self._true.get(drone, self._faces[drone].battery)

    def _batteries(self, drone: int) -> list[Battery]:
        return [fault for one, fault in self._active if one == drone and isinstance(fault, Battery)]

    def _is_lost(self, drone: int, message: str) -> bool:
        return any(isinstance(fault, StreamLost) and (one, fault.message) == (drone, message) for one, fault in self._active)

    def _drain(self, drone: int, fault: Battery) -> None:
        face = self._faces[drone]
        if fault.lies and drone not in self._true:
            self._true[drone], face.battery = face.battery, Cells(face.parameters, self._step_s)
        cells = face.battery if fault.lies else self._battery(drone)
        cells.used_mah = (1.0 - fault.level) * cells.capacity_mah
        if not fault.acts and drone not in self._actions:
            self._actions[drone] = face.parameters.wire(_ACTION)
            face.parameters.set(_ACTION, _ONLY_WARN)

    def _mend_battery(self, drone: int) -> None:
        face = self._faces[drone]
        face.battery = self._true.pop(drone, face.battery)
        if drone in self._actions:
            face.parameters.set(_ACTION, self._actions.pop(drone))

    def _side(self) -> float:
        """Draw left or right."""
        return 1.0 if self._rng.random() < 0.5 else -1.0

    def _direction(self) -> Array:
        """Draw a horizontal unit vector."""
        angle = float(self._rng.uniform(-pi, pi))
        return np.array([cos(angle), sin(angle), 0.0])

    def _jump(self, drone: int, shift_m: Array, turn_rad: float) -> None:
        east, north, up = shift_m.tolist()
        self._reset(drone, (east, north, up), turn_rad)

    def _mute(self, drone: int, message: str, *, muted: bool) -> None:
        """Switch one of a vehicle's MAVLink messages off or on, on all links."""
        number: int = getattr(mavlink, f"MAVLINK_MSG_ID_{message}")
        for link in self._faces[drone].links:
            (link.schedule.muted.add if muted else link.schedule.muted.discard)(number)

    def _push(self, drone: int) -> None:
        mine = [push for (pushed, _), push in self._pushes.items() if pushed == drone]
        self._motion.push_mps2[drone] = sum(mine, np.zeros(3))

    def _fail(self, drone: int, descent_mps: float) -> None:
        self._motion.fail(drone, descent_mps)
        self._faces[drone].commander.fail()
