"""What a vehicle tells of its condition, its places and its clock: one function for each message of its streams."""

from __future__ import annotations

from math import cos, nan, pi

from pymavlink.dialects.v20 import common as mavlink

from sim.vehicle.px4.state import Message, State

_NO_CELL = 65535
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
_GLOBAL_FLAGS = mavlink.ESTIMATOR_POS_HORIZ_ABS | mavlink.ESTIMATOR_PRED_POS_HORIZ_ABS


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


def extended_sys_state(state: State) -> Message:
    """EXTENDED_SYS_STATE."""
    return mavlink.MAVLink_extended_sys_state_message(mavlink.MAV_VTOL_STATE_UNDEFINED, state.commander.landed_state)


def sys_status(state: State) -> Message:
    """SYS_STATUS."""
    gps = mavlink.MAV_SYS_STATUS_SENSOR_GPS
    present = _SENSORS | (gps if state.receiver else 0) | _PREARM
    ready = state.commander.preflight_failure is None
    health = _SENSORS | (gps if state.reading is not None else 0) | (_PREARM if ready else 0)
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
    cells = [round(battery.voltage_v / battery.cells * 1e3)] * battery.cells + [_NO_CELL] * (10 - battery.cells)
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
    """HOME_POSITION; none without a place on the globe."""
    if not state.has_origin:
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
    """GPS_GLOBAL_ORIGIN; none without a place on the globe."""
    if not state.has_origin:
        return None
    latitude, longitude, altitude = state.origin
    return mavlink.MAVLink_gps_global_origin_message(
        round(latitude * 1e7), round(longitude * 1e7), round(altitude * 1e3), state.boot_us
    )


def estimator_status(state: State) -> Message:
    """ESTIMATOR_STATUS."""
    horizontal, vertical = state.position_sigma_m
    flags = _ATTITUDE_FLAGS
    if state.knows_position:
        flags = _POSITION_FLAGS if state.has_origin else _POSITION_FLAGS & ~_GLOBAL_FLAGS
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
