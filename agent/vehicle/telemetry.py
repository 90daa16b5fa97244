"""From the autopilot's messages to the vehicle's state."""

from __future__ import annotations

from math import isfinite, radians

from msgspec import Struct

from agent.attitude import Quaternion
from agent.config import VehicleConfig
from agent.vehicle.clock import BootClock
from agent.vehicle.frame import (
    enu_from_flu,
    enu_from_ned,
    enu_from_ned_position,
    heading,
    turned_on,
    up_share,
)
from agent.vehicle.health import not_ready
from agent.vehicle.interface import GnssFix, LaunchPlace, Vector3, VehicleState
from agent.vehicle.launch import LaunchSurvey
from agent.vehicle.messages import (
    Attitude,
    Battery,
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
from agent.vehicle.modes import ACTIVE, ARMED, CRITICAL, STANDBY, flight_mode, is_in_air
from agent.vehicle.requests import Seen
from agent.vehicle.resets import Resets

FRESH_S = 0.5  # older attitudes and ranges do not belong to the position
MISSING_S = 1.0  # for which a stream of 30 Hz must have failed before it is told
LOST_S = 2.5  # without a heartbeat: two of 1 Hz have failed to come
_DOWNWARD = 25  # MAV_SENSOR_ROTATION_PITCH_270
_INVALID_SIGNAL = 1  # percent, by the definition of DISTANCE_SENSOR
_FIX_3D = 3  # GPS_FIX_TYPE


class _Turning(Struct, frozen=True):
    """An attitude (NED <- FRD), how it changes, when it held by the autopilot's clock, and when it arrived."""

    quaternion: Quaternion
    rates_rps: Vector3
    boot_ms: int
    arrival_s: float


class Telemetry:
    """The newest of every message, and what follows from them. Only the newest counts; nothing is queued."""

    def __init__(self, config: VehicleConfig, launch: LaunchPlace | None, exact: bool = False) -> None:
        """``exact``: the mission takes the frame for known exactly, whatever happens to it."""
        self.launch = LaunchSurvey(launch, config.gnss, exact)
        self._resets = Resets(launch.resets if launch is not None else None)
        self._config = config
        self._clock = BootClock()
        self._heartbeat: Heartbeat | None = None
        self._heartbeat_s = self._position_s = float("-inf")
        self._range_m = (0.0, float("-inf"))  # along the sensor's axis; when it arrived
        self._extended: ExtendedState | None = None
        self._status: SystemStatus | None = None
        self._attitude: _Turning | None = None
        self._estimator_sigma_m = 0.0
        self._fix_us = -1  # of the newest fix
        self._battery: float | None = None
        self.begin_anew()

    def begin_anew(self) -> None:
        """The link is there for the first time or again: what the autopilot sends only once has to be had anew."""
        self.has_home = self.has_origin = False

    def receive(self, message: Message, arrival_ns: int, arrival_s: float) -> VehicleState | None:
        """Take a message; a position makes a new state, once everything else that it needs is known."""
        match message:
            case LocalPosition():
                return self._state(message, arrival_ns, arrival_s)
            case Attitude():
                self._attitude = _turning(message, arrival_s)
            case Odometry():
                self._resets.take_count(message.reset_counter, message.time_usec * 1e-6)
            case GpsRaw():
                self._resets.take_satellites(message.fix_type >= _FIX_3D)
            case Heartbeat():
                self._heartbeat, self._heartbeat_s = message, arrival_s
            case ExtendedState():
                self._extended = message
            case SystemStatus():
                self._status = message
            case DistanceSensor():
                self._take_range(message, arrival_s)
            case EstimatorStatus():
                sigmas = (message.pos_horiz_accuracy, message.pos_vert_accuracy)
                self._estimator_sigma_m = max(value for value in (*sigmas, 0.0) if value is not None)
            case Battery(id=0, battery_remaining=percent):
                self._battery = percent / 100.0 if percent >= 0 else None
            case HomePosition():
                self.has_home = True
            case GlobalOrigin():
                self.has_origin = True
                self.launch.take_origin(message)
        return None

    def fix(self, message: GpsRaw) -> GnssFix | None:
        """What the satellite receiver says; None where it has no position, says it again, or does not say how good it is."""
        stamp_ns = self._clock.utc_ns(message.time_usec * 1000)
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
        """Whether the autopilot's frame may have jumped a moment ago: what was planned in the old one should not be flown."""
        return self._resets.in_doubt

    @property
    def seen(self) -> Seen | None:
        """What the autopilot shows of its modes; None before it has shown all of it."""
        heartbeat, extended = self._heartbeat, self._extended
        if heartbeat is None or extended is None:
            return None
        mode = flight_mode(heartbeat.custom_mode)
        return Seen(
            mode=mode,
            armed=bool(heartbeat.base_mode & ARMED),
            in_air=is_in_air(extended.landed_state, mode),
            failsafe=heartbeat.system_status >= CRITICAL,
            heartbeat_s=self._heartbeat_s,
        )

    def is_lost(self, now_s: float) -> bool:
        """Whether the link is lost: no heartbeat for so long that two of 1 Hz have failed to come."""
        return now_s - self._heartbeat_s > LOST_S

    def problems(self, now_s: float) -> list[str]:
        """What stands against flying, by what the autopilot reports."""
        if self._heartbeat is None:
            return ["no heartbeat from the autopilot yet"]
        if self.is_lost(now_s):
            return [f"link to the autopilot lost: no heartbeat on {self._config.address}"]
        missing = self._missing(now_s)
        if missing:
            return [f"no {' and no '.join(missing)} from the autopilot"]
        seen = self.seen
        if seen is not None and seen.in_air:
            problems = ["the autopilot is in a failsafe"] if seen.failsafe else []
        else:
            reason = self.not_ready()
            where = f" in mode {seen.mode}" if seen is not None else ""  # from some modes it does not let itself be armed
            problems = [f"the autopilot is not ready to arm{where}: {reason}"] if reason is not None else []
        return problems + ([self.launch.problem] if self.launch.problem is not None else [])

    def _missing(self, now_s: float) -> list[str]:
        """What no state can be made without."""
        attitude_s = self._attitude.arrival_s if self._attitude is not None else float("-inf")
        arrivals_s = {"local position": self._position_s, "attitude": attitude_s}
        landed_state = ["landed state"] if self._extended is None else []
        return [name for name, at_s in arrivals_s.items() if now_s - at_s > MISSING_S] + landed_state

    def not_ready(self) -> str | None:
        """What keeps the autopilot from being armed, or None."""
        if self._status is None or self._heartbeat is None:
            return "its sensors are not known yet"
        reason = not_ready(self._status, self._config.gnss)
        if reason is not None:
            return reason
        if self._heartbeat.system_status not in (STANDBY, ACTIVE):
            return "it is still starting, calibrating or in a failsafe"
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
            position_sigma_m=max(self._config.position_sigma_m, self._estimator_sigma_m),
            yaw_sigma_rad=radians(self._config.yaw_sigma_deg),
            mode=seen.mode,
            armed=seen.armed,
            in_air=seen.in_air,
            healthy=self._is_healthy(seen),
            battery=self._battery,
        )

    def _is_healthy(self, seen: Seen) -> bool:
        """Ready to arm, or flying without a failsafe. Once it is armed, its readiness to arm is behind it."""
        return not seen.failsafe if seen.in_air or seen.armed else self.not_ready() is None

    def _take_range(self, message: DistanceSensor, arrival_s: float) -> None:
        within = message.min_distance < message.current_distance < message.max_distance
        if message.orientation == _DOWNWARD and within and message.signal_quality != _INVALID_SIGNAL:
            self._range_m = message.current_distance / 100.0, arrival_s

    def _height_m(self, above_launch_m: float, up: float, now_s: float) -> float:
        """Above ground by the rangefinder, whose axis tilts with the body; without it, above the launch place."""
        range_m, arrival_s = self._range_m
        return range_m * up if now_s - arrival_s <= FRESH_S else above_launch_m


def _vector(x: float | None, y: float | None, z: float | None) -> Vector3 | None:
    """The three numbers, if all are there and finite."""
    return None if x is None or y is None or z is None or not isfinite(x + y + z) else (x, y, z)


def _turning(message: Attitude, arrival_s: float) -> _Turning | None:
    """An attitude, if all of it is there and finite."""
    vector, rates_rps = (
        _vector(message.q2, message.q3, message.q4),
        _vector(message.rollspeed, message.pitchspeed, message.yawspeed),
    )
    if vector is None or rates_rps is None or message.q1 is None:
        return None
    return _Turning((message.q1, *vector), rates_rps, message.time_boot_ms, arrival_s)
