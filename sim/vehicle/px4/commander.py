"""PX4's commander: arming, modes, failsafes, landing; what the vehicle flies is the target that it leaves each step.

Two modes: the intention, what somebody chose last, and the mode that is flown; a failsafe makes them differ, and where its cause
goes they are one again. Positions are the vehicle's own, estimated, local frame ENU. Times are those of a real PX4, measured.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from pymavlink.dialects.v20 import common as mavlink

from agent.vehicle.interface import Vector3
from sim.vehicle.guidance import Guidance, Reframing, Target
from sim.vehicle.px4.failsafe import Failsafes, Fallback
from sim.vehicle.px4.modes import Mode
from sim.vehicle.px4.parameters import Parameters
from sim.vehicle.px4.setpoint import OffboardTarget
from sim.vehicle.px4.steering import Steering

ACCEPTED: int = mavlink.MAV_RESULT_ACCEPTED
TEMPORARILY_REJECTED: int = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
DENIED: int = mavlink.MAV_RESULT_DENIED
CRITICAL, INFO = mavlink.MAV_SEVERITY_CRITICAL, mavlink.MAV_SEVERITY_INFO
HEADING_STABLE_S = 4.7  # after the start
LIFTOFF_S = 1.0  # after the rotors have spun up
LANDED_S = 1.0  # of contact, coming down
FORCE = 21196.0

Reply = Callable[[int], None]
Say = Callable[[int, str], None]


class Commander:
    """One vehicle, advanced in fixed steps."""

    def __init__(
        self, parameters: Parameters, place: Vector3, yaw_rad: float, step_s: float, say: Say, unhealthy: str | None = None
    ) -> None:
        """Standing disarmed at ``place``. ``say``: severity and text. ``unhealthy``: a check that never passes."""
        self.mode = self.intention = Mode.HOLD
        self.armed = False
        self.landed = True
        self.fallback = Fallback()
        self._after_disarming = Mode.HOLD
        self._parameters = parameters
        self._guidance = Guidance(place, yaw_rad, step_s)
        self._steering = Steering(parameters, self._guidance, step_s)
        self._failsafes = Failsafes(parameters)
        self._say = say
        self._unhealthy = unhealthy
        self._position = place
        self._step_s = step_s
        self._time_s = 0.0
        self._armed_s = 0.0
        self._airborne_for_s = 0.0  # lifting, or in the air
        self._contact_for_s = 0.0
        self._landed_s = 0.0
        self._flown = False  # since it was armed
        self._offboard_s = float("-inf")
        self._at_the_sticks = False
        self._waiting: deque[tuple[Callable[[], int], Reply]] = deque()

    # What the links ask

    def ask(self, command: Callable[[], int], reply: Reply) -> None:
        """Have a command carried out within the next step; ``reply`` gets its MAV_RESULT."""
        self._waiting.append((command, reply))

    def follow(self, target: OffboardTarget) -> None:
        """A new offboard target; it counts for the stream in every mode, and is flown in offboard."""
        self._steering.offboard, self._offboard_s = target, self._time_s

    def hear_ground_station(self, silent_s: float | None) -> None:
        """For how long no ground station has been heard; none: there never was one."""
        self._failsafes.ground_station_silent_s = silent_s

    def know(self, position: bool, home: bool) -> None:
        """Whether the vehicle knows its position in its local frame, and a home on the globe."""
        self._failsafes.knows_position, self._failsafes.has_home = position, home

    def reframe(self, frame: Reframing) -> None:
        """The local frame has jumped. PX4's own modes take it into account; a target in offboard is the companion's affair."""
        self._guidance.reframe(frame)

    def set_mode(self, mode: Mode) -> int:
        """Somebody chooses a mode."""
        if mode is Mode.TAKEOFF:
            return self.take_off(None)
        if self.armed and mode is Mode.OFFBOARD and not self._stream_fresh:
            self._say(CRITICAL, "Switching to Offboard is currently not available")
            return TEMPORARILY_REJECTED
        lacks = not self._failsafes.knows_position or (mode is Mode.RETURN and not self._failsafes.has_home)
        if self.armed and lacks and not (mode.by_hand or mode is Mode.LAND):
            self._say(CRITICAL, f"Switching to {mode.name.title()} is currently not available")
            return TEMPORARILY_REJECTED
        if self.armed and mode.by_hand and not self._at_the_sticks:
            self._say(CRITICAL, f"Switching to {mode.name.title()} is currently not available")
            return TEMPORARILY_REJECTED
        self._choose(mode)
        return ACCEPTED

    def take_over(self) -> None:
        """Somebody takes the sticks, and the vehicle, in position mode; it hovers."""
        self._at_the_sticks = True
        self._choose(Mode.POSITION)

    def take_off(self, height_m: float | None) -> int:
        """To ``height_m`` above where it stands, or as MIS_TAKEOFF_ALT says; once it is armed."""
        self._steering.takeoff_m = self._parameters["MIS_TAKEOFF_ALT"] if height_m is None else height_m
        self._choose(Mode.TAKEOFF)
        return ACCEPTED

    def arm(self, force: bool) -> int:
        """Start the rotors."""
        if self.armed:
            return ACCEPTED
        failure = self.preflight_failure
        if failure is not None and not force:
            self._say(CRITICAL, f"Preflight Fail: {failure}")
            self._say(CRITICAL, "Arming denied: Resolve system health failures first")
            return TEMPORARILY_REJECTED
        self.armed, self._armed_s, self._flown = True, self._time_s, False
        self._guidance.home = self._position
        self._guidance.stay(self._position)
        self._say(INFO, "Armed by external command")
        return ACCEPTED

    def disarm(self, force: bool) -> int:
        """Stop the rotors; in the air only by force, and then it falls."""
        if self.armed and not self.landed and not force:
            self._say(CRITICAL, "Disarming denied: not landed")
            return TEMPORARILY_REJECTED
        if self.armed:
            self._disarm("external command")
        return ACCEPTED

    # What the outside sees

    @property
    def preflight_failure(self) -> str | None:
        """What stands against arming, in PX4's words."""
        if self._time_s < HEADING_STABLE_S:
            return "heading estimate not stable"
        if self._unhealthy is not None:
            return self._unhealthy
        if not self._failsafes.knows_position:
            return "position estimate error"
        if self.intention is Mode.OFFBOARD and not self._stream_fresh:
            return "No offboard signal"
        if self.intention.by_hand and not self._at_the_sticks:
            return "No manual control input"
        if self.intention.prevents_arming:
            return "Mode not suitable for arming"
        if self._parameters["NAV_DLL_ACT"] > 0 and self._failsafes.ground_station_lost:
            return "No connection to the GCS"
        return None

    @property
    def system_status(self) -> int:
        """MAV_STATE."""
        if self.fallback.active:
            return int(mavlink.MAV_STATE_CRITICAL)
        if self.armed:
            return int(mavlink.MAV_STATE_ACTIVE)
        ready = self.preflight_failure is None
        return int(mavlink.MAV_STATE_STANDBY if ready else mavlink.MAV_STATE_UNINIT)

    @property
    def landed_state(self) -> int:
        """MAV_LANDED_STATE."""
        if self.landed:
            return int(mavlink.MAV_LANDED_STATE_ON_GROUND)
        if self.mode is Mode.TAKEOFF:
            return int(mavlink.MAV_LANDED_STATE_TAKEOFF)
        return int(mavlink.MAV_LANDED_STATE_LANDING if self._steering.landing else mavlink.MAV_LANDED_STATE_IN_AIR)

    @property
    def home(self) -> Vector3:
        """Where it was armed last, or stands."""
        return self._guidance.home if self.armed else self._position

    @property
    def target(self) -> Target:
        """What the vehicle is to follow now; where the position is NaN only the velocity counts."""
        return self._guidance.target

    @property
    def grounded(self) -> bool:
        """Standing, with rotors that stand or idle."""
        return self.landed and self._airborne_for_s == 0.0

    # One step

    def step(self, time_s: float, position: Vector3, contact: bool) -> None:
        """Advance to ``time_s``; ``contact``: the vehicle touches the ground."""
        self._time_s, self._position = time_s, position
        while self._waiting:
            command, reply = self._waiting.popleft()
            reply(command())
        self._watch_failsafes()
        self._watch_ground(contact)
        self._fly()

    @property
    def _stream_fresh(self) -> bool:
        return self._time_s - self._offboard_s <= self._parameters["COM_OF_LOSS_T"]

    def _choose(self, mode: Mode) -> None:
        self.intention = mode
        if not mode.prevents_arming:
            self._after_disarming = mode
        self._failsafes.mode_chosen()
        self._switch(mode)

    def _switch(self, mode: Mode) -> None:
        """Fly another mode; those of the autopilot's own begin from where the vehicle is."""
        if mode is self.mode:
            return
        self.mode = mode
        self._steering.begin(mode, self._position)

    def _watch_failsafes(self) -> None:
        if not self.armed:
            self.fallback = Fallback()
            self._switch(self.intention)
            return
        silent_s = self._time_s - self._offboard_s if self.intention is Mode.OFFBOARD else 0.0
        before = self.fallback
        self.fallback = self._failsafes.check(silent_s, self._position, self._guidance.home)
        if self.fallback.active and not before.active:
            self._say(CRITICAL, "Failsafe activated")
        self._switch(self.fallback.mode or self.intention)

    def _watch_ground(self, contact: bool) -> None:
        if self.armed and self._wants_up:
            self._airborne_for_s += self._step_s
        elif self.landed:
            self._airborne_for_s = 0.0
        if self.landed and self._airborne_for_s > LIFTOFF_S:
            self.landed, self._flown = False, True
        coming_down = not self.armed or not self.target.velocity[2] > 0.0
        self._contact_for_s = self._contact_for_s + self._step_s if contact and coming_down else 0.0
        if not self.landed and self._contact_for_s > LANDED_S:
            self.landed, self._airborne_for_s, self._steering.landing = True, 0.0, False
            self._landed_s = self._time_s
        if self.armed and self.landed and self._airborne_for_s == 0.0:
            self._disarm_when_idle()

    def _disarm_when_idle(self) -> None:
        if self._flown and self._time_s - self._landed_s > self._parameters["COM_DISARM_LAND"] > 0.0:
            self._disarm("landing")
        elif not self._flown and self._time_s - self._armed_s > self._parameters["COM_DISARM_PRFLT"] > 0.0:
            self._disarm("preflight inaction")

    def _disarm(self, reason: str) -> None:
        self.armed = False
        self.intention = self._after_disarming
        self._failsafes.mode_chosen()
        self._say(INFO, f"Disarmed by {reason}")

    @property
    def _wants_up(self) -> bool:
        """Rotors spun up, and something to climb to."""
        if not self.landed:
            return True
        spun_up = self._time_s - self._armed_s >= self._parameters["COM_SPOOLUP_TIME"]
        return spun_up and self._steering.wants_up(self.mode, self._position)

    def _fly(self) -> None:
        if self.grounded:
            return
        if not self.armed:
            self._steering.fall(self._position)
        elif self._steering.fly(self.mode, self._position):
            self._choose(Mode.HOLD)
