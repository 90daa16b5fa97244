"""Emulation of PX4's commander: arming, modes, failsafes, landing. It decides the target that the vehicle flies to.

There are two modes: the intended one, which was chosen last, and the one being flown; a failsafe makes them differ until its
cause ends. Positions are the vehicle's own estimates, local frame ENU. Times are measured ones of a real PX4.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import hypot

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from radron.sim.geometry import Vector3
from radron.sim.vehicle.guidance import REST, Guidance, Reframing, Target
from radron.sim.vehicle.px4 import events
from radron.sim.vehicle.px4.arming import ArmingChecks, Readiness
from radron.sim.vehicle.px4.battery import Warning
from radron.sim.vehicle.px4.events import Announcement, By
from radron.sim.vehicle.px4.failsafe import Failsafes, Fallback, Situation
from radron.sim.vehicle.px4.landing import DRIFTING_MPS, SPOOL_UP_S, LandDetector
from radron.sim.vehicle.px4.mavlink.setpoint import OffboardTarget
from radron.sim.vehicle.px4.modes import Mode
from radron.sim.vehicle.px4.parameters import Parameters
from radron.sim.vehicle.px4.steering import Steering

ACCEPTED: int = mavlink.MAV_RESULT_ACCEPTED
TEMPORARILY_REJECTED: int = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
DENIED: int = mavlink.MAV_RESULT_DENIED
IDLE_S = 1.1  # in addition to COM_DISARM_PRFLT
FORCE = 21196.0
ACCELERATION_S = 0.1  # time constant of the measured acceleration
MOTOR_FAILED = "Motor failure"

Reply = Callable[[int], None]


class Commander:
    """Emulates the commander (mode logic) of one PX4 vehicle in fixed time steps.

    To be set before each step: knows_position, in its local frame; has_home, on the globe; home_altitude_m, above the sea;
    fixless, without the satellites that it needs; station_lost and station_missing, the ground station; battery. armed_s: time of
    the last arming.
    """

    def __init__(
        self,
        parameters: Parameters,
        place: Vector3,
        yaw_rad: float,
        step_s: float,
        rng: np.random.Generator,
        announce: Callable[[Announcement], None],
        unhealthy: str | None = None,
    ) -> None:
        """Start with the vehicle disarmed on the ground at ``place``. ``unhealthy``: a check that never passes."""
        self.mode = self.intention = Mode.HOLD
        self.armed = False
        self.fallback = Fallback()
        self.knows_position = self.has_home = True
        self.station_lost, self.station_missing = False, True
        self.fixless = False
        self.battery = Warning.NONE
        self.home_altitude_m = 0.0
        self.checks = ArmingChecks(parameters, rng, announce, unhealthy)
        self._after_disarming = Mode.HOLD
        self._parameters = parameters
        self._announce = announce
        self._guidance = Guidance(place, yaw_rad, step_s)
        self._steering = Steering(parameters, self._guidance, step_s)
        self._failsafes = Failsafes(parameters, step_s, announce)
        self._ground = LandDetector(step_s, rng)
        self._position = place
        self._velocity = self._acceleration = REST
        self._drifting = self._failed = False
        self._time_s = 0.0
        self.armed_s = 0.0
        self._offboard_s = float("-inf")
        self._at_the_sticks = False
        self._taking_off = False  # from the ground, as TAKEOFF does
        self._waiting: deque[tuple[Callable[[], int], Reply]] = deque()

    # Requests of the links

    def ask(self, command: Callable[[], int], reply: Reply) -> None:
        """Execute a command within the next time step; ``reply`` gets its MAV_RESULT."""
        self._waiting.append((command, reply))

    def follow(self, target: OffboardTarget) -> None:
        """Accept a new offboard target (setpoint of a companion computer).

        The target counts as a sign of life in every mode, and is flown to in offboard mode.
        """
        self._steering.offboard, self._offboard_s = target, self._time_s

    def reframe(self, frame: Reframing) -> None:
        """Adapt to a jump of the local frame.

        PX4's autonomous modes take it into account; offboard targets are left to the companion computer.
        """
        self._guidance.reframe(frame)

    def set_mode(self, mode: Mode) -> int:
        """Choose a flight mode; return the MAV_RESULT."""
        if mode is Mode.TAKEOFF:
            return self.take_off(None)
        if self.armed and mode is Mode.OFFBOARD and not self._stream_fresh:
            return TEMPORARILY_REJECTED
        if self.armed and not self._is_possible(mode):
            if mode is not Mode.OFFBOARD:
                self._announce(events.unavailable(mode))
            return TEMPORARILY_REJECTED
        self._choose(mode)
        return ACCEPTED

    def land(self) -> int:
        """Begin to land at the present position; return the MAV_RESULT."""
        result = self.set_mode(Mode.LAND)
        if result == ACCEPTED:
            self._announce(events.LANDING_HERE)
        return result

    def take_over(self) -> None:
        """Begin a manual override by the sticks, in position mode; the pilot hovers."""
        self._at_the_sticks = True
        self._choose(Mode.POSITION)

    def fail(self) -> None:
        """Let the motors fail: the vehicle descends in any mode, is disarmed on the ground, and never armed again."""
        self._failed = True

    def take_off(self, height_m: float | None) -> int:
        """Begin a takeoff to ``height_m`` above the present place, or to MIS_TAKEOFF_ALT, once the vehicle is armed.

        Return the MAV_RESULT.
        """
        if self.armed and not self._is_possible(Mode.TAKEOFF):
            return TEMPORARILY_REJECTED
        self._steering.takeoff_m = self._parameters["MIS_TAKEOFF_ALT"] if height_m is None else height_m
        self._choose(Mode.TAKEOFF)
        if self.armed and height_m is None:
            self._announce(events.takeoff_height(self._steering.takeoff_m))
        return ACCEPTED

    def arm(self, force: bool) -> int:
        """Start the rotors; return the MAV_RESULT. ``force``: without the checks."""
        if self.armed:
            return ACCEPTED
        if self._failed or (self.preflight_failure is not None and not force):
            self._announce(events.ARMING_DENIED)
            return TEMPORARILY_REJECTED
        self.armed, self.armed_s = True, self._time_s
        self._ground.arm()
        self._guidance.home = self._position
        self._guidance.stay(self._position)
        self._announce(events.armed())
        if self.mode is Mode.TAKEOFF:
            self._announce(events.takeoff_height(self._steering.takeoff_m))
        return ACCEPTED

    def disarm(self, force: bool) -> int:
        """Stop the rotors; return the MAV_RESULT. In the air only by ``force``, and then the vehicle falls."""
        if self.armed and not self.landed and not force:
            self._announce(events.DISARMING_DENIED)
            return TEMPORARILY_REJECTED
        if self.armed:
            self._disarm(By.COMMAND)
        return ACCEPTED

    # State shown to the outside

    @property
    def landed(self) -> bool:
        """Whether the land detector reports that the vehicle is on the ground."""
        return self._ground.landed

    @property
    def preflight_failure(self) -> str | None:
        """Why arming is denied, in PX4's words; None if it is allowed."""
        if self._failed:
            return MOTOR_FAILED
        return self.checks.failure(
            Readiness(
                armed=self.armed,
                mode=self.mode,
                stream=self._stream_fresh,
                at_the_sticks=self._at_the_sticks,
                knows_position=self.knows_position,
                station_missing=self.station_missing,
                beyond_fence=self._failsafes.beyond_fence,
                battery=self.battery,
            )
        )

    @property
    def system_status(self) -> int:
        """State of the vehicle as a number of MAVLink's MAV_STATE."""
        if self.fallback.active:
            return int(mavlink.MAV_STATE_CRITICAL)
        if self.armed:
            return int(mavlink.MAV_STATE_ACTIVE)
        ready = self.preflight_failure is None
        return int(mavlink.MAV_STATE_STANDBY if ready else mavlink.MAV_STATE_UNINIT)

    @property
    def landed_state(self) -> int:
        """State of takeoff and landing as a number of MAVLink's MAV_LANDED_STATE."""
        if self.landed:
            return int(mavlink.MAV_LANDED_STATE_ON_GROUND)
        if self._taking_off:
            return int(mavlink.MAV_LANDED_STATE_TAKEOFF)
        return int(mavlink.MAV_LANDED_STATE_LANDING if self._steering.landing else mavlink.MAV_LANDED_STATE_IN_AIR)

    @property
    def home(self) -> Vector3:
        """Place of the last arming, or the present place before any."""
        return self._guidance.home if self.armed else self._position

    @property
    def target(self) -> Target:
        """The target that the vehicle flies to now; if its position is NaN, only the velocity counts."""
        return self._guidance.target

    @property
    def grounded(self) -> bool:
        """Whether the vehicle stands on the ground, with rotors that are stopped or do not lift it."""
        return self._ground.standing

    # One step

    def step(self, time_s: float, position: Vector3, velocity: Vector3, contact: bool) -> None:
        """Emulate the commander for the time step until ``time_s``. ``contact``: the vehicle touches the ground."""
        self._follow_motion(time_s, position, velocity)
        self._drifting = hypot(velocity[0], velocity[1]) > DRIFTING_MPS
        self.checks.step(time_s, self.fixless and not self.armed)
        while self._waiting:
            command, reply = self._waiting.popleft()
            reply(command())
        self._watch_failsafes()
        self._watch_ground(contact)
        self._fly()

    def _follow_motion(self, time_s: float, position: Vector3, velocity: Vector3) -> None:
        """Take the estimates; the acceleration follows from them by a low-pass."""
        step_s = time_s - self._time_s
        if step_s > 0.0:
            share = step_s / (step_s + ACCELERATION_S)
            pairs = zip(self._acceleration, self._velocity, velocity, strict=True)
            x, y, z = (old + share * ((now - before) / step_s - old) for old, before, now in pairs)
            self._acceleration = x, y, z
        self._time_s, self._position, self._velocity = time_s, position, velocity

    @property
    def _stream_fresh(self) -> bool:
        return self._time_s - self._offboard_s <= self._parameters["COM_OF_LOSS_T"]

    def _is_possible(self, mode: Mode) -> bool:
        """Return whether the conditions of a mode are met for an armed vehicle."""
        if mode.by_hand:
            return self._at_the_sticks
        return self.knows_position and (mode is not Mode.RETURN or self.has_home)

    def _choose(self, mode: Mode) -> None:
        self.intention = mode
        if not mode.prevents_arming:
            self._after_disarming = mode
        self._failsafes.mode_chosen()
        self._switch(mode)

    def _switch(self, mode: Mode) -> None:
        """Fly another mode; autonomous ones begin from the vehicle's position."""
        if mode is self.mode:
            return
        self.mode = mode
        self._taking_off = False
        velocity, acceleration = (REST, REST) if self.landed else (self._velocity, self._acceleration)
        self._steering.begin(mode, self._position, velocity, acceleration, standing=self.landed, back=self.fallback.here)
        if mode is Mode.RETURN and self.armed:
            above_m = self._steering.return_m
            self._announce(events.return_begins(self.home_altitude_m + above_m, above_m))

    def _watch_failsafes(self) -> None:
        if not self.armed:
            self.fallback = Fallback()
            self._failsafes.warn(self.battery)
            self._switch(self.intention)
            return
        if self._failed:
            self.fallback = Fallback(True, Mode.LAND)
            self._switch(Mode.LAND)
            return
        situation = Situation(
            offboard_silent_s=self._time_s - self._offboard_s if self.intention is Mode.OFFBOARD else 0.0,
            position=self._position,
            home=self._guidance.home,
            knows_position=self.knows_position,
            has_home=self.has_home,
            station_lost=self.station_lost,
            battery=self.battery,
        )
        self.fallback = self._failsafes.check(situation, self.intention)
        self._switch(self.fallback.mode or self.intention)

    def _watch_ground(self, contact: bool) -> None:
        ground = self._ground
        if not ground.landed:
            wants_down = not self.armed or self._steering.wants_down(self.mode, self._position)
            noticeable = not self.armed or (not self._drifting and self._steering.commanded_to_sink(self.mode))
            ground.fly(contact, wants_down, noticeable, self.mode)
            if ground.notice(self._time_s, self.armed):
                self._taking_off = self._steering.landing = False
                if self.armed:
                    self._announce(events.LANDING_DETECTED)
        elif self.armed:
            spun_up = self._time_s - self.armed_s >= SPOOL_UP_S
            if ground.rise(spun_up and self._steering.wants_up(self.mode, self._position)):
                self._taking_off = self.mode is Mode.TAKEOFF
                self._announce(events.TAKEOFF_DETECTED)
            self._disarm_when_idle()

    def _disarm_when_idle(self) -> None:
        ground, value = self._ground, self._parameters
        if ground.flown and ground.landed and self._time_s - ground.landed_s > value["COM_DISARM_LAND"] > 0.0:
            self._disarm(By.LANDING)
        elif not ground.flown and self._time_s - self.armed_s - IDLE_S > value["COM_DISARM_PRFLT"] > 0.0:
            self._disarm(By.IDLENESS)

    def _disarm(self, by: By) -> None:
        self.armed = False
        self.intention = self._after_disarming
        self.fallback = Fallback()
        self._failsafes.end()
        self._switch(self.intention)
        self._announce(events.disarmed(by))

    def _fly(self) -> None:
        if not self.armed:
            if not self.landed:
                self._steering.fall(self._position)
        elif not self.landed:
            landing = self._steering.landing
            if self._steering.fly(self.mode, self._position, self._velocity, self._ground.climbing_s):
                self._choose(Mode.HOLD)
                self._steering.end_takeoff()
            if self.mode is Mode.RETURN and self._steering.landing and not landing:
                self._announce(events.RETURN_LANDS)
