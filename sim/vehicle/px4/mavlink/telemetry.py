"""MAVLink messages about an emulated vehicle's motion and sensors: one function builds each message."""

from __future__ import annotations

from math import atan2, cos, hypot, nan, pi, sin

from pymavlink.dialects.v20 import common as mavlink

from radron.sim.vehicle.multirotor import GRAVITY_MPS2
from radron.sim.vehicle.px4.filter.estimate import Estimate
from radron.sim.vehicle.px4.state import Message, State

RANGE_M = (0.1, 40.0)  # of the rangefinder
SATELLITES = 10
_NO_FIX = mavlink.GPS_FIX_TYPE_NO_GPS  # also with a receiver on board, as recorded
_NOT_READ, _UNKNOWN = 65535, 255
_CRUISE_THROTTLE = 50


def attitude(state: State) -> Message:
    """Build ATTITUDE: roll, pitch, yaw and their rates."""
    now = state.now
    return mavlink.MAVLink_attitude_message(state.boot_ms, now.roll_rad, now.pitch_rad, now.yaw_rad, *now.rates_rps)


def attitude_quaternion(state: State) -> Message:
    """Build ATTITUDE_QUATERNION: attitude and angular rates."""
    now = state.now
    return mavlink.MAVLink_attitude_quaternion_message(state.boot_ms, *_quaternion(now), *now.rates_rps)


def local_position(state: State) -> Message:
    """Build LOCAL_POSITION_NED: position and velocity in the local frame; None if the position is unknown."""
    if not state.knows_position:
        return None
    now = state.now
    return mavlink.MAVLink_local_position_ned_message(state.boot_ms, *now.position_ned_m, *now.velocity_ned_mps)


def global_position(state: State) -> Message:
    """Build GLOBAL_POSITION_INT: geographic position and velocity; None without a geographic position."""
    if not state.has_origin:
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
    """Build GPS_RAW_INT: reading of the satellite receiver.

    Its height above the sea equals the height above the ellipsoid, as no geoid is simulated.
    """
    reading = state.reading
    if reading is None:
        seen = 0 if state.receiver else _UNKNOWN
        return mavlink.MAVLink_gps_raw_int_message(state.boot_us, _NO_FIX, 0, 0, 0, *[_NOT_READ] * 4, seen)
    latitude, longitude, altitude = reading.place
    north, east, _ = state.now.velocity_ned_mps
    course = _centidegrees(atan2(east, north))
    altitude_mm = round(altitude * 1e3)
    return mavlink.MAVLink_gps_raw_int_message(
        reading.boot_us,
        mavlink.GPS_FIX_TYPE_3D_FIX,
        round(latitude * 1e7),
        round(longitude * 1e7),
        altitude_mm,
        70,
        100,
        round(hypot(north, east) * 100.0),
        course,
        SATELLITES,
        altitude_mm,
        round(reading.horizontal_m * 1e3),
        round(reading.vertical_m * 1e3),
        100,
        0,
    )


def odometry(state: State) -> Message:
    """Build ODOMETRY: pose and velocity in the local frame with their covariance."""
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
        state.resets % 256,
        mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT,
        100,
    )


def highres_imu(state: State) -> Message:
    """Build HIGHRES_IMU: acceleration, angular rates, magnetic field and pressure."""
    now = state.now
    pressure, altitude = _pressure_hpa(now.place.altitude_m), now.place.altitude_m
    field = (0.21 * cos(now.yaw_rad), -0.21 * sin(now.yaw_rad), 0.43)  # gauss, central Europe, level
    return mavlink.MAVLink_highres_imu_message(
        state.boot_us, 0.0, 0.0, -now.thrust_mps2, *now.rates_rps, *field, pressure, 0.0, altitude, 25.0, 0x1FFF
    )


def scaled_pressure(state: State) -> Message:
    """Build SCALED_PRESSURE: air pressure."""
    return mavlink.MAVLink_scaled_pressure_message(state.boot_ms, _pressure_hpa(state.now.place.altitude_m), 0.0, 2500)


def distance_sensor(state: State) -> Message:
    """Build DISTANCE_SENSOR: distance to the ground by the rangefinder."""
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
    """Build ALTITUDE: heights above sea, home and ground."""
    now = state.now
    up = now.position_enu_m[2]
    relative = now.place.altitude_m - state.home_altitude_m if state.has_origin else nan
    return mavlink.MAVLink_altitude_message(
        state.boot_us, now.place.altitude_m, now.place.altitude_m, up, relative, nan, now.height_m
    )


def vfr_hud(state: State) -> Message:
    """Build VFR_HUD: speeds, heading, throttle and altitude for displays."""
    now = state.now
    north, east, down = now.velocity_ned_mps
    throttle = 0 if state.commander.grounded else _CRUISE_THROTTLE
    heading = round(now.yaw_rad * 180.0 / pi) % 360
    return mavlink.MAVLink_vfr_hud_message(0.0, hypot(north, east), heading, throttle, now.place.altitude_m, -down)


def servo_output(state: State) -> Message:
    """Build SERVO_OUTPUT_RAW: pulses to the motors."""
    pulse = 900 if not state.commander.armed else 1000 if state.commander.grounded else 1500
    return mavlink.MAVLink_servo_output_raw_message(state.boot_us & 0xFFFFFFFF, 0, *[pulse] * 4, 0, 0, 0, 0)


def attitude_target(state: State) -> Message:
    """Build ATTITUDE_TARGET: attitude and thrust that the controllers want."""
    now = state.now
    thrust = 0.0 if state.commander.grounded else 0.5 * now.thrust_mps2 / GRAVITY_MPS2
    return mavlink.MAVLink_attitude_target_message(state.boot_ms, 0, list(_quaternion(now)), 0.0, 0.0, 0.0, thrust)


def hil_state(state: State) -> Message:
    """Build HIL_STATE_QUATERNION: the true state, which PX4's own simulator sends on request."""
    if state.truth is None:
        return None
    true = state.truth()
    latitude, longitude, altitude = true.place
    north, east, down = (round(speed * 100.0) for speed in true.velocity_ned_mps)
    rates = true.rates_rps
    return mavlink.MAVLink_hil_state_quaternion_message(
        state.boot_us,
        list(_quaternion(true)),
        *rates,
        round(latitude * 1e7),
        round(longitude * 1e7),
        round(altitude * 1e3),
        north,
        east,
        down,
        *[0] * 5,
    )


def position_target(state: State) -> Message:
    """Build POSITION_TARGET_LOCAL_NED: position and velocity that the controllers want."""
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
