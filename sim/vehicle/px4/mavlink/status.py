"""MAVLink messages about an emulated vehicle's condition, places and clock: one function builds each message."""

from __future__ import annotations

from math import cos, nan, pi

from pymavlink.dialects.v20 import common as mavlink

from radron.sim.vehicle.px4.arming import HEADING
from radron.sim.vehicle.px4.battery import Warning
from radron.sim.vehicle.px4.mavlink.dialect import AvailableModes, CurrentEventSequence, CurrentMode, ProtocolVersion
from radron.sim.vehicle.px4.modes import Mode
from radron.sim.vehicle.px4.state import Message, State

_NO_CELL = 65535
# SYS_STATUS as recorded. RC_RECEIVER is enabled and never present; the arming checks are reported as healthy, never as present.
_GPS, _POSITION = mavlink.MAV_SYS_STATUS_SENSOR_GPS, mavlink.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL
_BATTERY, _PREARM = mavlink.MAV_SYS_STATUS_SENSOR_BATTERY, mavlink.MAV_SYS_STATUS_PREARM_CHECK
_PRESENT, _ENABLED_ONLY, _HEALTHY = 0x200400F, mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER, 0x320883F
_UNCHECKED = 0x321C83F  # healthy before the first checks; nothing is present then
_HEIGHT_FLAGS = (
    mavlink.ESTIMATOR_ATTITUDE | mavlink.ESTIMATOR_VELOCITY_VERT | mavlink.ESTIMATOR_POS_VERT_ABS | mavlink.ESTIMATOR_POS_VERT_AGL
)
_PREDICTED_FLAGS = mavlink.ESTIMATOR_PRED_POS_HORIZ_REL | mavlink.ESTIMATOR_PRED_POS_HORIZ_ABS
_POSITION_FLAGS = mavlink.ESTIMATOR_VELOCITY_HORIZ | mavlink.ESTIMATOR_POS_HORIZ_REL | mavlink.ESTIMATOR_POS_HORIZ_ABS
_GLOBAL_FLAGS = mavlink.ESTIMATOR_POS_HORIZ_ABS | mavlink.ESTIMATOR_PRED_POS_HORIZ_ABS
# PX4's names and order; 1: advanced by PX4's own flag, 2: not selectable.
_MODES = (
    ("Manual", Mode.MANUAL, 1),
    ("Altitude", Mode.ALTITUDE, 0),
    ("Position", Mode.POSITION, 0),
    ("Hold", Mode.HOLD, 1),
    ("Return", Mode.RETURN, 1),
    ("Descend", Mode.DESCEND, 3),
    ("Offboard", Mode.OFFBOARD, 1),
    ("Stabilized", Mode.STABILIZED, 1),
    ("Takeoff", Mode.TAKEOFF, 1),
    ("Land", Mode.LAND, 1),
)


def heartbeat(state: State) -> Message:
    """Build HEARTBEAT: flight mode, armed flag and state of the vehicle."""
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
    """Build EXTENDED_SYS_STATE: whether the vehicle is on the ground, taking off, in the air or landing."""
    return mavlink.MAVLink_extended_sys_state_message(mavlink.MAV_VTOL_STATE_UNDEFINED, state.commander.landed_state)


def current_mode(state: State) -> Message:
    """Build CURRENT_MODE: the mode being flown and the intended mode."""
    commander = state.commander
    mode, intended = commander.mode, commander.intention
    return CurrentMode(standard_mode=mode.standard_mode, custom_mode=mode.custom_mode, intended_custom_mode=intended.custom_mode)


def current_event_sequence(state: State) -> Message:
    """Build CURRENT_EVENT_SEQUENCE: number of the latest event."""
    return CurrentEventSequence(sequence=state.events, flags=0)


def sys_status(state: State) -> Message:
    """Build SYS_STATUS: health of sensors and battery."""
    commander, battery = state.commander, state.battery
    present, enabled, health = _condition(state) if commander.checks.running else (0, 0, _UNCHECKED)
    return mavlink.MAVLink_sys_status_message(
        present,
        enabled,
        health,
        300,
        round(battery.voltage_v * 1e3),
        round(battery.current_a * 100.0),
        round(battery.remaining * 100.0),
        *[0] * 6,
    )


def _condition(state: State) -> tuple[int, int, int]:
    """Present, enabled and healthy."""
    commander = state.commander
    guided = state.receiver and state.reckoning.fused and commander.preflight_failure != HEADING
    present = _PRESENT | (_GPS if guided else 0)
    health = _HEALTHY | (_POSITION if state.knows_position else 0)
    if commander.preflight_failure is None:
        health |= _PREARM
    if commander.battery > Warning.NONE:
        health &= ~_BATTERY
    if not state.receiver or (state.reading is None and not commander.armed):
        health &= ~_GPS
    return present, present | _ENABLED_ONLY, health


def battery_status(state: State) -> Message:
    """Build BATTERY_STATUS: voltages, current and remaining charge."""
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
    """Build HOME_POSITION, the place of the last arming; None without a geographic position."""
    if not state.has_origin:
        return None
    now = state.now
    east, north, _ = state.commander.home
    # Close enough to the vehicle for a plane; the home altitude wanders, and its local z with it.
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
    """Build GPS_GLOBAL_ORIGIN, the geographic origin of the local frame; None without one."""
    if not state.has_origin:
        return None
    latitude, longitude, altitude = state.origin
    return mavlink.MAVLink_gps_global_origin_message(
        round(latitude * 1e7), round(longitude * 1e7), round(altitude * 1e3), state.boot_us
    )


def estimator_status(state: State) -> Message:
    """Build ESTIMATOR_STATUS: health and accuracy of the filter. Without comparisons with satellites there are no test ratios."""
    reckoning = state.reckoning
    flags = _HEIGHT_FLAGS
    if not state.commander.armed:
        flags |= mavlink.ESTIMATOR_CONST_POS_MODE
    if state.knows_position:
        flags |= _POSITION_FLAGS | _PREDICTED_FLAGS
        if not state.has_origin:
            flags &= ~_GLOBAL_FLAGS
    elif reckoning.fused:
        flags |= _PREDICTED_FLAGS
    ratios = (reckoning.velocity_ratio, reckoning.position_ratio) if reckoning.fused else (nan, nan)
    return mavlink.MAVLink_estimator_status_message(state.boot_us, flags, *ratios, 0.05, 0.1, 0.1, 0.0, *state.position_sigma_m)


def system_time(state: State) -> Message:
    """Build SYSTEM_TIME: UTC and time since the start."""
    return mavlink.MAVLink_system_time_message(state.utc_ns // 1000, state.boot_ms)


def timesync(state: State) -> Message:
    """Build TIMESYNC as a request for the companion's time."""
    return mavlink.MAVLink_timesync_message(0, int(state.boot_s * 1e9))


def protocol_version(state: State) -> Message:
    """Build PROTOCOL_VERSION: the supported versions of MAVLink."""
    return ProtocolVersion(
        version=200, min_version=100, max_version=200, spec_version_hash=bytes(8), library_version_hash=bytes(8)
    )


def available_modes(which: int) -> list[Message]:
    """Build AVAILABLE_MODES for one flight mode, counted from 1, or for all modes (0); none if there is no such mode."""
    messages: list[Message] = []
    for place, (name, mode, properties) in enumerate(_MODES, start=1):
        if which in (0, place):
            named = b"" if mode.standard_mode else name.encode()
            messages.append(
                AvailableModes(
                    custom_mode=mode.custom_mode,
                    properties=properties,
                    number_modes=len(_MODES),
                    mode_index=place,
                    standard_mode=mode.standard_mode,
                    mode_name=named,
                )
            )
    return messages


def mission_current(state: State) -> Message:
    """Build MISSION_CURRENT: no mission is flown."""
    return mavlink.MAVLink_mission_current_message(0)


def autopilot_version(state: State) -> Message:
    """Build AUTOPILOT_VERSION: software version and capabilities.

    Of PX4's capabilities (0xe8ff) it states those that this vehicle has: no files, no control of attitudes.
    """
    capabilities = (
        mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
        | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
        | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
        | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
        | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    )
    return mavlink.MAVLink_autopilot_version_message(
        capabilities, state.software, 0, state.software, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, state.uid
    )
