"""From the autopilot's messages to the vehicle's state."""

from __future__ import annotations

from math import hypot, isfinite, radians

from msgspec import Struct

from radron.agent.config.drone import VehicleConfig
from radron.agent.geometry import Quaternion, Vector3
from radron.agent.vehicle.batteries import ALL, Batteries
from radron.agent.vehicle.clock import BootClock
from radron.agent.vehicle.frame import (
    enu_from_flu,
    enu_from_ned,
    enu_from_ned_position,
    heading,
    turned_on,
    up_share,
)
from radron.agent.vehicle.health import not_ready
from radron.agent.vehicle.interface import FlightMode, GnssFix, LaunchPlace, VehicleState
from radron.agent.vehicle.launch import LaunchSurvey
from radron.agent.vehicle.mavlink.messages import (
    Attitude,
    Battery,
    CurrentMode,
    DistanceSensor,
    EstimatorStatus,
    ExtendedState,
    GlobalOrigin,
    GpsRaw,
    Heartbeat,
    HomePosition,
    LocalPosition,
    Message,
    Odometry,
    SystemStatus,
)
from radron.agent.vehicle.modes import ACTIVE, ARMED, CRITICAL, STANDBY, flight_mode, is_in_air
from radron.agent.vehicle.requests import Seen
from radron.agent.vehicle.resets import Resets
from radron.agent.vehicle.trust import PositionTrust
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

FRESH_S = 0.5  # older attitudes and ranges are not used with a position
MISSING_S = 1.0  # a stream of 30 Hz that has been missing for this long is reported
LANDED_S = 3.0  # one of 5 Hz
BACK_S = 1.2  # after a gap in all messages a heartbeat, at 1 Hz, is waited for this long
LOST_S = 2.5  # without a heartbeat: two at 1 Hz have been lost
NORM_ERROR = 0.01  # of a quaternion in single precision: far more than rounding
_DOWNWARD = 25  # MAV_SENSOR_ROTATION_PITCH_270
_INVALID_SIGNAL = 1  # percent, as defined for DISTANCE_SENSOR
_FIX_3D = 3  # GPS_FIX_TYPE


class _Turning(Struct, frozen=True):
    """An attitude (NED <- FRD) and its rates, with its time by the autopilot's clock and its arrival."""

    quaternion: Quaternion
    rates_rps: Vector3
    boot_ms: int
    arrival_s: float


class Telemetry:
    """Turns the messages of an autopilot into vehicle states. It keeps the newest message of each kind, and queues nothing."""

    def __init__(self, config: VehicleConfig, launch: LaunchPlace | None, exact: bool = False) -> None:
        """Start without messages.

        ``launch``: launch place stored before a restart; ``exact``: the mission's local frame is known exactly.
        """
        self.launch = LaunchSurvey(launch, config.gnss, exact)
        self._resets = Resets(launch.resets if launch is not None else None, axes_fixed=config.by_satellites)
        self._trust = PositionTrust(config.by_satellites)
        self._config = config
        self._clock = BootClock()
        self._heartbeat: Heartbeat | None = None
        self._heartbeat_s = self._position_s = self._heard_s = float("-inf")
        self._back_s = float("-inf")  # when the newest gap in all messages ended
        self._range_m = (0.0, float("-inf"))  # along the sensor's axis; when it arrived
        self._intended: FlightMode | None = None
        self._extended: ExtendedState | None = None
        self._extended_s = float("-inf")
        self._status: SystemStatus | None = None
        self._attitude: _Turning | None = None
        self._estimator_sigma_m = 0.0
        self._fix_us = -1  # of the newest fix
        self._batteries = Batteries()
        self.begin_anew()

    def begin_anew(self) -> None:
        """Forget the messages that the autopilot sends only once, when the link comes up for the first time or again.

        They have to be requested again.
        """
        self.has_home = self.has_origin = False
        self._intended = None

    def receive(self, message: Message, arrival_ns: int, arrival_s: float) -> VehicleState | None:
        """Take a message of the autopilot. A position returns a new vehicle state once all other parts of the state are known.

        arrival_ns, arrival_s: time of arrival, own time, and by a clock that never goes back.
        """
        if arrival_s - self._heard_s > MISSING_S and not self.awaits_mode(arrival_s):
            self._back_s = arrival_s
        self._heard_s = arrival_s
        match message:
            case LocalPosition():
                return self._state(message, arrival_ns, arrival_s)
            case Attitude():
                self._attitude = _turning(message, arrival_s)
            case Odometry():
                self._resets.take_count(message.reset_counter, message.time_usec * 1e-6)
            case GpsRaw():
                found = message.fix_type >= _FIX_3D
                self._resets.take_satellites(found)
                self._trust.take_fix(found, arrival_s)
            case Heartbeat() | CurrentMode() | ExtendedState() | SystemStatus():
                self._take_condition(message, arrival_s)
            case DistanceSensor():
                self._take_range(message, arrival_s)
            case EstimatorStatus():
                sigmas = (message.pos_horiz_accuracy, message.pos_vert_accuracy)
                self._estimator_sigma_m = max(value for value in (*sigmas, 0.0) if value is not None)
                self._trust.take_estimator(message, arrival_s)
            case Battery(id=number, battery_remaining=percent):
                self._batteries.take(number, percent, arrival_s)
            case HomePosition():
                self.has_home = True
            case GlobalOrigin():
                self.has_origin = True
                self.launch.take_origin(message)
        return None

    def fix(self, message: GpsRaw) -> GnssFix | None:
        """Return the position of the satellite receiver in a message; None without a position or its accuracy, or for a
        repetition.
        """
        stamp_ns = self._clock.own_ns(message.time_usec * 1000)
        if stamp_ns is None or message.fix_type < _FIX_3D or message.h_acc <= 0 or message.v_acc <= 0:
            return None
        if message.time_usec == self._fix_us:
            return None
        self._fix_us = message.time_usec
        return GnssFix(
            stamp_ns=stamp_ns,
            latitude_deg=message.lat * 1e-7,
            longitude_deg=message.lon * 1e-7,
            altitude_m=message.alt_ellipsoid * 1e-3,
            horizontal_sigma_m=message.h_acc * 1e-3,
            vertical_sigma_m=message.v_acc * 1e-3,
        )

    @property
    def frame_in_doubt(self) -> bool:
        """Whether the autopilot's frame may just have jumped: plans in the old frame must not be flown."""
        return self._resets.in_doubt

    @property
    def has_rebooted(self) -> bool:
        """Whether the autopilot was booted again since the first message from it."""
        return self._clock.has_rebooted

    @property
    def seen(self) -> Seen | None:
        """Mode and state shown by the autopilot's newest messages; None before all are known."""
        heartbeat, extended = self._heartbeat, self._extended
        if heartbeat is None or extended is None:
            return None
        mode, armed = flight_mode(heartbeat.custom_mode), bool(heartbeat.base_mode & ARMED)
        is_fresh = self._heartbeat_s - self._extended_s <= LANDED_S
        return Seen(
            mode=mode,
            armed=armed,
            in_air=is_in_air(extended.landed_state) and (armed or is_fresh),  # else it would never have landed
            failsafe=heartbeat.system_status >= CRITICAL,
            heartbeat_s=self._heartbeat_s,
            intended=self._intended,
        )

    def is_lost(self, now_s: float) -> bool:
        """Whether the link to the autopilot is lost: no heartbeat for ``LOST_S``."""
        return now_s - self._heartbeat_s > LOST_S

    def awaits_mode(self, now_s: float) -> bool:
        """Whether the autopilot's known mode is older than a gap in all its messages, so that the next heartbeat must be
        awaited.
        """
        return self._heartbeat_s < self._back_s and now_s - self._back_s < BACK_S

    def problems(self, now_s: float) -> list[CodedText]:
        """Return the reasons why the vehicle cannot fly, by the autopilot's reports, one line each."""
        if self._heartbeat is None:
            return [CodedText(Code.AUTOPILOT_LINK_LOST, "no heartbeat from the autopilot yet")]
        if self.is_lost(now_s):
            text = f"link to the autopilot lost: no heartbeat on {self._config.address}"
            return [CodedText(Code.AUTOPILOT_LINK_LOST, text)]
        missing = self._missing(now_s)
        if missing:
            return [CodedText(Code.AUTOPILOT_DATA_MISSING, f"no {' and no '.join(missing)} from the autopilot")]
        seen = self.seen
        if seen is not None and seen.in_air:
            problems = [CodedText(Code.FAILSAFE, "the autopilot is in a failsafe")] if seen.failsafe else []
        else:
            reason = self.not_ready()
            where = f" in mode {seen.mode}" if seen is not None else ""  # in some modes it cannot be armed
            text = f"the autopilot is not ready to arm{where}: {reason}"
            problems = [CodedText(Code.NOT_READY_TO_ARM, text)] if reason is not None else []
        told = (self._trust.problem(now_s), self._batteries.problem(now_s), self.launch.problem)
        return problems + [problem for problem in told if problem is not None]

    def _missing(self, now_s: float) -> list[str]:
        """The missing inputs without which there is no state."""
        attitude_s = self._attitude.arrival_s if self._attitude is not None else float("-inf")
        arrivals_s = {"local position": self._position_s, "attitude": attitude_s}
        landed_state = ["landed state"] if now_s - self._extended_s > LANDED_S else []
        return [name for name, at_s in arrivals_s.items() if now_s - at_s > MISSING_S] + landed_state

    def not_ready(self) -> str | None:
        """Return the reason why the autopilot cannot arm; None if it can."""
        if self._status is None or self._heartbeat is None:
            return "no sensor status yet"
        reason = not_ready(self._status)
        if reason is not None:
            return reason
        if self._heartbeat.system_status not in (STANDBY, ACTIVE):
            return "still starting, calibrating or in a failsafe"
        return None if self.has_home or not self._config.gnss else "no home position yet"

    def _state(self, message: LocalPosition, arrival_ns: int, arrival_s: float) -> VehicleState | None:
        stamp_ns = self._clock.observe(message.time_boot_ms, arrival_ns)
        seen = self.seen
        place_m, velocity_mps = _vector(message.x, message.y, message.z), _vector(message.vx, message.vy, message.vz)
        if place_m is not None:
            self._position_s = arrival_s
        if seen is None or place_m is None or velocity_mps is None:
            return None
        attitude = self._attitude
        if attitude is None or arrival_s - attitude.arrival_s > FRESH_S:
            return None
        quaternion = turned_on(attitude.quaternion, attitude.rates_rps, (message.time_boot_ms - attitude.boot_ms) * 1e-3)
        yaw_rad, turning_rps = heading(quaternion, attitude.rates_rps)
        jumped = self._resets.judge(message.time_boot_ms * 1e-3, place_m, velocity_mps, yaw_rad, turning_rps)
        if jumped is None:
            return None
        if jumped:
            self.launch.jumped()
            self._trust.jumped(arrival_s, moved=self._resets.moved)
        booted_ns, resets = self._clock.booted_ns, self._resets.count
        self.launch.observe(arrival_s, place_m, seen.armed, seen.in_air, booted_ns, resets)
        launch = self.launch.place
        if launch is None:
            return None
        position_m = enu_from_ned_position(place_m, launch)
        return VehicleState(
            stamp_ns=stamp_ns,
            epoch=launch.epoch,
            position_m=position_m,
            velocity_mps=enu_from_ned(velocity_mps),
            quaternion=enu_from_flu(quaternion),
            height_m=self._height_m(position_m[2], up_share(quaternion), arrival_s),
            position_sigma_m=max(self._config.position_sigma_m, self._estimator_sigma_m) + self._trust.drift_m(arrival_s),
            yaw_sigma_rad=radians(self._config.yaw_sigma_deg),
            mode=seen.mode,
            armed=seen.armed,
            in_air=seen.in_air,
            healthy=self._is_healthy(seen),
            battery=self._batteries.level(arrival_s),
            position_trusted=self._trust.at(arrival_s),
            aided=self._trust.hears_satellites(arrival_s),
            axes_fixed=self._config.by_satellites,
        )

    def _is_healthy(self, seen: Seen) -> bool:
        """Ready to arm, or flying without a failsafe. Once it is armed, readiness to arm does not matter."""
        return not seen.failsafe if seen.in_air or seen.armed else self.not_ready() is None

    def _take_condition(self, message: Heartbeat | CurrentMode | ExtendedState | SystemStatus, arrival_s: float) -> None:
        match message:
            case Heartbeat():
                self._heartbeat, self._heartbeat_s = message, arrival_s
            case CurrentMode(intended_custom_mode=intended):
                self._intended = flight_mode(intended) if intended else None
            case ExtendedState():
                self._extended, self._extended_s = message, arrival_s
            case SystemStatus(battery_remaining=percent):
                self._status = message
                self._batteries.take(ALL, percent, arrival_s)

    def _take_range(self, message: DistanceSensor, arrival_s: float) -> None:
        within = message.min_distance < message.current_distance < message.max_distance
        if message.orientation == _DOWNWARD and within and message.signal_quality != _INVALID_SIGNAL:
            self._range_m = message.current_distance / 100.0, arrival_s

    def _height_m(self, above_launch_m: float, up: float, now_s: float) -> float:
        """Height above ground by the rangefinder, whose axis tilts with the body; without it, above the launch place."""
        range_m, arrival_s = self._range_m
        return range_m * up if now_s - arrival_s <= FRESH_S else above_launch_m


def _vector(x: float | None, y: float | None, z: float | None) -> Vector3 | None:
    """The three numbers, if all are there and finite."""
    return None if x is None or y is None or z is None or not isfinite(x + y + z) else (x, y, z)


def _turning(message: Attitude, arrival_s: float) -> _Turning | None:
    """An attitude, if all of it is there and finite, and its quaternion is one of a rotation."""
    vector, rates_rps = (
        _vector(message.q2, message.q3, message.q4),
        _vector(message.rollspeed, message.pitchspeed, message.yawspeed),
    )
    if vector is None or rates_rps is None or message.q1 is None or abs(hypot(message.q1, *vector) - 1.0) > NORM_ERROR:
        return None
    return _Turning((message.q1, *vector), rates_rps, message.time_boot_ms, arrival_s)
