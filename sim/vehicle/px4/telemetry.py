"""What a vehicle tells of itself: one function for each message of its streams, from its state now."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import atan2, cos, hypot, nan, pi, sin
from typing import Any, TypeAlias

from pymavlink.dialects.v20 import common as mavlink

from sim.vehicle.multirotor import GRAVITY_MPS2
from sim.vehicle.px4.battery import Battery
from sim.vehicle.px4.commander import Commander
from sim.vehicle.px4.estimate import Estimate, Geodetic

Message: TypeAlias = Any  # pymavlink has no types
RANGE_M = (0.1, 40.0)  # of the rangefinder
NOT_READ = 65535
_GPS_FIX_S = 3.0  # after the start: then there are a position on the globe, the origin, and home
_CRUISE_THROTTLE = 50
_SENSORS = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | mavlink.MAV_SYS_STATUS_AHRS
    | mavlink.MAV_SYS_STATUS_SENSOR_BATTERY
)
_PREARM = mavlink.MAV_SYS_STATUS_PREARM_CHECK
_ATTITUDE_FLAGS = mavlink.ESTIMATOR_ATTITUDE | mavlink.ESTIMATOR_VELOCITY_VERT | mavlink.ESTIMATOR_POS_VERT_ABS
_POSITION_FLAGS = (
    _ATTITUDE_FLAGS
    | mavlink.ESTIMATOR_VELOCITY_HORIZ
    | mavlink.ESTIMATOR_POS_HORIZ_REL
    | mavlink.ESTIMATOR_POS_HORIZ_ABS
    | mavlink.ESTIMATOR_POS_VERT_AGL
    | mavlink.ESTIMATOR_PRED_POS_HORIZ_REL
    | mavlink.ESTIMATOR_PRED_POS_HORIZ_ABS
)


@dataclass(slots=True)
class State:
    """What the messages are made of. ``home_altitude_m`` wanders in flight, as PX4's does; ``position_sigma_m``: horizontal,
    vertical, by the filter's own account.
    """

    commander: Commander
    battery: Battery
    origin: Geodetic  # of the local frame
    position_sigma_m: tuple[float, float]
    uid: int = 0
    boot_s: float = 0.0
    utc_ns: int = 0
    estimate: Estimate | None = None
    home_altitude_m: float = 0.0

    @property
    def now(self) -> Estimate:
        """The newest estimate; there is one from the first step on."""
        assert self.estimate is not None
        return self.estimate

    @property
    def boot_ms(self) -> int:
        """PX4's clock."""
        return int(self.boot_s * 1e3)

    @property
    def boot_us(self) -> int:
        """PX4's clock."""
        return int(self.boot_s * 1e6)

    @property
    def has_fix(self) -> bool:
        """GNSS is there."""
        return self.boot_s >= _GPS_FIX_S


def heartbeat(state: State) -> Message:
    """HEARTBEAT."""
    commander = state.commander
    mode = commander.mode
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR,
        mavlink.MAV_AUTOPILOT_PX4,
        mode.base_mode(commander.armed),
        mode.custom_mode,
        commander.system_status,
        3,
    )


def attitude(state: State) -> Message:
    """ATTITUDE."""
    now = state.now
    return mavlink.MAVLink_attitude_message(state.boot_ms, now.roll_rad, now.pitch_rad, now.yaw_rad, *now.rates_rps)


def attitude_quaternion(state: State) -> Message:
    """ATTITUDE_QUATERNION."""
    now = state.now
    return mavlink.MAVLink_attitude_quaternion_message(state.boot_ms, *_quaternion(now), *now.rates_rps)


def local_position(state: State) -> Message:
    """LOCAL_POSITION_NED."""
    now = state.now
    return mavlink.MAVLink_local_position_ned_message(state.boot_ms, *now.position_ned_m, *now.velocity_ned_mps)


def global_position(state: State) -> Message:
    """GLOBAL_POSITION_INT; none before there is a fix."""
    if not state.has_fix:
        return None
    now = state.now
    latitude, longitude, altitude = now.place
    north, east, down = now.velocity_ned_mps
    return mavlink.MAVLink_global_position_int_message(
        state.boot_ms,
        round(latitude * 1e7),
        round(longitude * 1e7),
        round(altitude * 1e3),
        round((altitude - state.home_altitude_m) * 1e3),
        round(north * 100.0),
        round(east * 100.0),
        round(down * 100.0),
        _centidegrees(now.yaw_rad),
    )


def gps_raw(state: State) -> Message:
    """GPS_RAW_INT."""
    now = state.now
    if not state.has_fix:
        return mavlink.MAVLink_gps_raw_int_message(state.boot_us, 1, 0, 0, 0, NOT_READ, NOT_READ, NOT_READ, NOT_READ, 0)
    latitude, longitude, altitude = now.place
    north, east, _ = now.velocity_ned_mps
    course = _centidegrees(atan2(east, north))
    return mavlink.MAVLink_gps_raw_int_message(
        state.boot_us,
        3,
        round(latitude * 1e7),
        round(longitude * 1e7),
        round(altitude * 1e3),
        70,
        100,
        round(hypot(north, east) * 100.0),
        course,
        12,
    )


def odometry(state: State) -> Message:
    """ODOMETRY."""
    now = state.now
    horizontal, vertical = (sigma**2 for sigma in state.position_sigma_m)
    pose_covariance = [nan] * 21  # upper triangle of 6 x 6
    for index, variance in zip((0, 6, 11), (0.5 * horizontal, 0.5 * horizontal, vertical), strict=True):
        pose_covariance[index] = variance
    return mavlink.MAVLink_odometry_message(
        state.boot_us,
        mavlink.MAV_FRAME_LOCAL_NED,
        mavlink.MAV_FRAME_LOCAL_NED,
        *now.position_ned_m,
        list(_quaternion(now)),
        *now.velocity_ned_mps,
        *now.rates_rps,
        pose_covariance,
        [nan] * 21,
        0,
        mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT,
        100,
    )


def highres_imu(state: State) -> Message:
    """HIGHRES_IMU."""
    now = state.now
    pressure, altitude = _pressure_hpa(now.place.altitude_m), now.place.altitude_m
    field = (0.21 * cos(now.yaw_rad), -0.21 * sin(now.yaw_rad), 0.43)  # gauss, central Europe, level
    return mavlink.MAVLink_highres_imu_message(
        state.boot_us, 0.0, 0.0, -now.thrust_mps2, *now.rates_rps, *field, pressure, 0.0, altitude, 25.0, 0x1FFF
    )


def scaled_pressure(state: State) -> Message:
    """SCALED_PRESSURE."""
    return mavlink.MAVLink_scaled_pressure_message(state.boot_ms, _pressure_hpa(state.now.place.altitude_m), 0.0, 2500)


def distance_sensor(state: State) -> Message:
    """DISTANCE_SENSOR."""
    now = state.now
    lowest, highest = RANGE_M
    slant_m = max(0.0, now.height_m) / max(0.1, cos(now.roll_rad) * cos(now.pitch_rad))
    return mavlink.MAVLink_distance_sensor_message(
        state.boot_ms,
        round(lowest * 100.0),
        round(highest * 100.0),
        round(min(slant_m, highest + 1.0) * 100.0),
        mavlink.MAV_DISTANCE_SENSOR_LASER,
        0,
        mavlink.MAV_SENSOR_ROTATION_PITCH_270,
        0,
    )


def altitude(state: State) -> Message:
    """ALTITUDE."""
    now = state.now
    up = now.position_enu_m[2]
    relative = now.place.altitude_m - state.home_altitude_m if state.has_fix else nan
    return mavlink.MAVLink_altitude_message(
        state.boot_us, now.place.altitude_m, now.place.altitude_m, up, relative, nan, now.height_m
    )


def vfr_hud(state: State) -> Message:
    """VFR_HUD."""
    now = state.now
    north, east, down = now.velocity_ned_mps
    throttle = 0 if state.commander.grounded else _CRUISE_THROTTLE
    heading = round(now.yaw_rad * 180.0 / pi) % 360
    return mavlink.MAVLink_vfr_hud_message(0.0, hypot(north, east), heading, throttle, now.place.altitude_m, -down)


def servo_output(state: State) -> Message:
    """SERVO_OUTPUT_RAW."""
    pulse = 900 if not state.commander.armed else 1000 if state.commander.grounded else 1500
    return mavlink.MAVLink_servo_output_raw_message(state.boot_us & 0xFFFFFFFF, 0, *[pulse] * 4, 0, 0, 0, 0)


def attitude_target(state: State) -> Message:
    """ATTITUDE_TARGET."""
    now = state.now
    thrust = 0.0 if state.commander.grounded else 0.5 * now.thrust_mps2 / GRAVITY_MPS2
    return mavlink.MAVLink_attitude_target_message(state.boot_ms, 0, list(_quaternion(now)), 0.0, 0.0, 0.0, thrust)


def position_target(state: State) -> Message:
    """POSITION_TARGET_LOCAL_NED."""
    target = state.commander.target
    (east, north, up), (v_east, v_north, v_up) = target.position, target.velocity
    return mavlink.MAVLink_position_target_local_ned_message(
        state.boot_ms,
        mavlink.MAV_FRAME_LOCAL_NED,
        0,
        north,
        east,
        -up,
        v_north,
        v_east,
        -v_up,
        nan,
        nan,
        nan,
        _wrapped(pi / 2.0 - target.yaw),
        0.0,
    )


def extended_sys_state(state: State) -> Message:
    """EXTENDED_SYS_STATE."""
    return mavlink.MAVLink_extended_sys_state_message(mavlink.MAV_VTOL_STATE_UNDEFINED, state.commander.landed_state)


def sys_status(state: State) -> Message:
    """SYS_STATUS."""
    gps = mavlink.MAV_SYS_STATUS_SENSOR_GPS
    present = _SENSORS | gps | _PREARM
    ready = state.commander.preflight_failure is None
    health = _SENSORS | (gps if state.has_fix else 0) | (_PREARM if ready else 0)
    battery = state.battery
    return mavlink.MAVLink_sys_status_message(
        present,
        present,
        health,
        300,
        round(battery.voltage_v * 1e3),
        round(battery.current_a * 100.0),
        round(battery.remaining * 100.0),
        *[0] * 6,
    )


def battery_status(state: State) -> Message:
    """BATTERY_STATUS."""
    battery = state.battery
    cells = [round(battery.voltage_v / battery.cells * 1e3)] * battery.cells + [NOT_READ] * (10 - battery.cells)
    return mavlink.MAVLink_battery_status_message(
        0,
        mavlink.MAV_BATTERY_FUNCTION_ALL,
        mavlink.MAV_BATTERY_TYPE_LIPO,
        32767,
        cells,
        round(battery.current_a * 100.0),
        round(battery.used_mah),
        -1,
        round(battery.remaining * 100.0),
        0,
        mavlink.MAV_BATTERY_CHARGE_STATE_OK,
    )


def home_position(state: State) -> Message:
    """HOME_POSITION; none before there is a fix."""
    if not state.has_fix:
        return None
    now = state.now
    east, north, _ = state.commander.home
    # Near enough to the vehicle for a plane; the home altitude wanders, and its local z with it.
    latitude = now.place.latitude_deg + (north - now.position_enu_m[1]) / 111_132.0
    per_degree = 111_320.0 * cos(now.place.latitude_deg * pi / 180.0)
    longitude = now.place.longitude_deg + (east - now.position_enu_m[0]) / per_degree
    down = state.origin.altitude_m - state.home_altitude_m
    return mavlink.MAVLink_home_position_message(
        round(latitude * 1e7),
        round(longitude * 1e7),
        round(state.home_altitude_m * 1e3),
        north,
        east,
        down,
        [1.0, 0.0, 0.0, 0.0],
        nan,
        nan,
        nan,
        state.boot_us,
    )


def gps_global_origin(state: State) -> Message:
    """GPS_GLOBAL_ORIGIN; none before there is a fix."""
    if not state.has_fix:
        return None
    latitude, longitude, altitude = state.origin
    return mavlink.MAVLink_gps_global_origin_message(
        round(latitude * 1e7), round(longitude * 1e7), round(altitude * 1e3), state.boot_us
    )


def estimator_status(state: State) -> Message:
    """ESTIMATOR_STATUS."""
    horizontal, vertical = state.position_sigma_m
    flags = _POSITION_FLAGS if state.has_fix else _ATTITUDE_FLAGS
    return mavlink.MAVLink_estimator_status_message(state.boot_us, flags, 0.05, 0.05, 0.05, 0.1, 0.1, 0.0, horizontal, vertical)


def system_time(state: State) -> Message:
    """SYSTEM_TIME."""
    return mavlink.MAVLink_system_time_message(state.utc_ns // 1000, state.boot_ms)


def timesync(state: State) -> Message:
    """TIMESYNC: a request."""
    return mavlink.MAVLink_timesync_message(0, int(state.boot_s * 1e9))


def mission_current(state: State) -> Message:
    """MISSION_CURRENT."""
    return mavlink.MAVLink_mission_current_message(0)


def autopilot_version(state: State) -> Message:
    """AUTOPILOT_VERSION."""
    capabilities = (
        mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
        | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
        | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    )
    version = 0x01_11_00_00  # 1.17.0, a development version
    return mavlink.MAVLink_autopilot_version_message(
        capabilities, version, 0, version, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, state.uid
    )


Builder = Callable[[State], Message]


def _quaternion(now: Estimate) -> tuple[float, float, float, float]:
    """(w, x, y, z), NED from FRD."""
    cr, sr = cos(0.5 * now.roll_rad), sin(0.5 * now.roll_rad)
    cp, sp = cos(0.5 * now.pitch_rad), sin(0.5 * now.pitch_rad)
    cy, sy = cos(0.5 * now.yaw_rad), sin(0.5 * now.yaw_rad)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def _wrapped(angle_rad: float) -> float:
    return (angle_rad + pi) % (2.0 * pi) - pi


def _centidegrees(angle_rad: float) -> int:
    return round(angle_rad * 18_000.0 / pi) % 36_000


def _pressure_hpa(altitude_m: float) -> float:
    """Standard atmosphere."""
    return float(1013.25 * (1.0 - 2.25577e-5 * altitude_m) ** 5.25588)
