"""Lockstep's autopilot: PX4's arming, takeoff, modes, landing, and offboard-loss failsafe.

Positions are the vehicle's own estimates in its local frame (ENU), as in PX4.
"""

from __future__ import annotations

from agent.vehicle.interface import FlightMode, Request, VehicleCommand
from sim.geometry import Vector3
from sim.vehicle.guidance import ARRIVED_M, BELOW_GROUND_M, Guidance, Reframing, Target

ARMING_S = 1.0
TAKEOFF_SPEED_MPS = 1.0
LANDING_SPEED_MPS = 0.7
RETURN_SPEED_MPS = 5.0
RETURN_HEIGHT_M = 10.0
DISARM_AFTER_S = 2.0
OFFBOARD_LOSS_S = 1.0


class Autopilot:
    """The flight-mode logic of one vehicle, advanced in fixed steps."""

    def __init__(self, home: Vector3, yaw: float, step_s: float) -> None:
        self.mode = FlightMode.HOLD
        self.armed = False
        self.in_air = False
        self.failsafe = False
        self._guidance = Guidance(home, yaw, step_s)
        self._position = home
        self._ground_m = home[2]
        self._step_s = step_s
        self._armed_for = 0.0
        self._landed_for = 0.0
        self._takeoff_height = 0.0
        self._setpoint_age = float("inf")

    @property
    def target(self) -> Target:
        """The target that the vehicle follows now."""
        return self._guidance.target

    @property
    def setpoint_age_s(self) -> float | None:
        """Age of the setpoint that the vehicle follows; None where it follows none."""
        return self._setpoint_age if self.mode is FlightMode.OFFBOARD else None

    @property
    def grounded(self) -> bool:
        """Whether the vehicle is on the ground with idling or stopped rotors."""
        return not self.armed or (self.mode is FlightMode.TAKEOFF and self._armed_for < ARMING_S)

    def command(self, command: VehicleCommand) -> None:
        """Apply the pilot's command of this step."""
        request = command.request
        if command.setpoint is not None:
            self._setpoint_age = 0.0
        if request is Request.TAKEOFF:
            self._take_off(command.takeoff_height_m)
        elif request is Request.OFFBOARD and self.in_air and command.setpoint is not None:
            self.mode, self.failsafe = FlightMode.OFFBOARD, False
            setpoint = command.setpoint
            self._guidance.target = Target(
                setpoint.position_m, setpoint.velocity_mps, setpoint.yaw_rad, setpoint.acceleration_mps2, setpoint.yaw_rate_rps
            )
        elif self.armed and request is Request.HOLD and self.in_air and self.mode is not FlightMode.HOLD:
            self._switch(FlightMode.HOLD)
        elif self.armed and request is Request.RETURN and self.mode not in (FlightMode.RETURN, FlightMode.LAND):
            self._switch(FlightMode.RETURN)
        elif self.armed and request is Request.LAND and self.mode is not FlightMode.LAND:
            self._switch(FlightMode.LAND)

    def reframe(self, frame: Reframing) -> None:
        """The vehicle's local frame has jumped, and its filter reports it."""
        self._guidance.reframe(frame)

    def step(self, position: Vector3, ground_m: float | None = None) -> None:
        """Advance the mode logic by one step.

        ``position``: the vehicle's own estimate; ``ground_m``: z of the ground below it (None: as at home), at which the rotors
        are unloaded.
        """
        self._position = position
        self._ground_m = self._guidance.home[2] if ground_m is None else ground_m
        self._setpoint_age += self._step_s
        self._armed_for = self._armed_for + self._step_s if self.armed else 0.0
        if self.mode is FlightMode.OFFBOARD and self._setpoint_age > OFFBOARD_LOSS_S:
            self._switch(FlightMode.RETURN)
            self.failsafe = True
        if self.grounded:
            return
        if self.mode is FlightMode.TAKEOFF:
            self._climb(position)
        elif self.mode is FlightMode.RETURN:
            self._return_home()
        elif self.mode is FlightMode.LAND:
            self._descend(position)

    def _switch(self, mode: FlightMode) -> None:
        """Change to an autonomous mode: it begins from the vehicle's position, not from the last setpoint."""
        self.mode = mode
        self._guidance.stay(self._position)

    def _take_off(self, height: float) -> None:
        if not self.armed:
            self.armed, self.mode = True, FlightMode.TAKEOFF
            self._takeoff_height = height
            self._landed_for = 0.0
            self._guidance.stay(self._guidance.home)

    def _climb(self, position: Vector3) -> None:
        self._guidance.climb(self._takeoff_height, TAKEOFF_SPEED_MPS)
        if position[2] > self._guidance.home[2] + self._takeoff_height - ARRIVED_M:
            self.mode, self.in_air = FlightMode.HOLD, True
            self._guidance.stay(self.target.position)

    def _return_home(self) -> None:
        if self._guidance.go_home(RETURN_HEIGHT_M, TAKEOFF_SPEED_MPS, RETURN_SPEED_MPS):
            self.mode = FlightMode.LAND

    def _descend(self, position: Vector3) -> None:
        self._guidance.descend(LANDING_SPEED_MPS, self._ground_m - self._guidance.home[2] - BELOW_GROUND_M)
        if position[2] < self._ground_m + ARRIVED_M:
            self._landed_for += self._step_s
            if self._landed_for > DISARM_AFTER_S:
                self.armed = self.in_air = self.failsafe = False
                self.mode = FlightMode.HOLD
