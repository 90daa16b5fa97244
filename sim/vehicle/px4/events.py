"""PX4's announcements: events, which go to every link, and texts, which go to links with a ground station.

An event crosses the link as a number with arguments; names and words are in metadata that PX4 keeps. The relevant ones are listed
here, with numbers, levels and arguments as recorded of PX4 v1.17. Some have no text, and a text may differ from its event's
words.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from radron.sim.vehicle.px4.modes import Mode

_EMERGENCY, _CRITICAL = mavlink.MAV_SEVERITY_EMERGENCY, mavlink.MAV_SEVERITY_CRITICAL
_INFO = mavlink.MAV_SEVERITY_INFO
_NO_MODE_NO_COMPONENT = bytes.fromhex("ffffffff")  # of arming checks: the modes that they prevent; the component follows


class Announcement(NamedTuple):
    """Something that PX4 announces: an event, a text, or both.

    number: number of the event; None: text only. levels: the event's levels, internal and external. text: for ground stations;
    PX4 ends a text with a tab if an event reports the announcement as well.
    """

    number: int | None
    levels: int
    arguments: bytes
    severity: int
    text: str | None


class Action(IntEnum):
    """What a failsafe of PX4 does, numbered as in its events."""

    HOLD = 5
    RETURN = 6
    LAND = 7
    DESCEND = 8


class Cause(IntEnum):
    """Why a failsafe of PX4 acts, numbered as in its events; causes without a number of their own are generic."""

    GENERIC = 0
    GROUND_STATION_LOST = 2
    BATTERY_CRITICAL = 4
    BATTERY_EMERGENCY = 5


class By(IntEnum):
    """Why a vehicle was armed or disarmed, numbered as in PX4's events."""

    COMMAND = 4
    LANDING = 6
    IDLENESS = 7


_BY = {By.COMMAND: "external command", By.LANDING: "landing", By.IDLENESS: "auto preflight disarming"}


def _plain(number: int, levels: int, severity: int, text: str | None, arguments: str = "") -> Announcement:
    return Announcement(number, levels, bytes.fromhex(arguments), severity, text)


def _check(number: int, levels: int, severity: int, text: str | None, component: int) -> Announcement:
    return Announcement(number, levels, _NO_MODE_NO_COMPONENT + bytes([component]), severity, text)


ARMING_DENIED = _plain(0x102089D, 0x62, _CRITICAL, "Arming denied: Resolve system health failures first\t")
DISARMING_DENIED = _plain(0x18AB9B5, 0x62, _CRITICAL, "Disarming denied: not landed\t")
HEADING_UNSTABLE = _plain(0x1FDF2ED, 0x33, _CRITICAL, "Preflight Fail: heading estimate not stable", "7ed17e0011")
NO_GROUND_STATION = _check(0x167C97B, 0x66, _INFO, None, 0x0C)
FIX_TOO_LOW = _plain(0x1BCBE91, 0x44, mavlink.MAV_SEVERITY_WARNING, "Preflight: GPS fix too low", "7c007e0003")
BATTERY_LOW = _check(0x14D0DA4, 0x22, _CRITICAL, "Low battery\t", 0x0B)
BATTERY_CRITICAL = _check(0x128180B, 0x22, _CRITICAL, "Critical battery\t", 0x0B)
BATTERY_EMERGENCY = _check(0x1AD1B07, 0x00, _EMERGENCY, "Emergency battery level\t", 0x0B)
RETURN_ADVISED = _plain(0x1BA6953, 0x64, _INFO, None)
BEYOND_FENCE = _check(0x13E092F, 0x33, _CRITICAL, "Geofence: exceeding maximum distance to Home", 0x14)
TAKEOFF_DETECTED = _plain(0x1414569, 0x66, _INFO, "Takeoff detected\t")
LANDING_DETECTED = _plain(0x19638AC, 0x66, _INFO, "Landing detected\t")
LANDING_HERE = _plain(0x132B2DE, 0x66, _INFO, "Landing at current position\t")
RETURN_LANDS = _plain(0x102D3AA, 0x66, _INFO, "RTL: land at destination\t")
OVERRULED = _plain(0x10EAC3F, 0x66, _INFO, None)
FUSION_STOPPED = _plain(0x1E04AA7, 0x66, _INFO, None)
FUSION_STARTED = _plain(0x1E95843, 0x66, _INFO, None)
GROUND_STATION_LOST = _plain(0x1A4B458, 0x64, _INFO, "Connection to ground station lost\t")
GROUND_STATION_REGAINED = _plain(0x1D93424, 0x66, _INFO, "GCS connection regained\t")
COMPANION_LOST = _plain(0x1A9B99D, 0x22, _INFO, None)
COMPANION_REGAINED = _plain(0x1A3870B, 0x66, _INFO, "Onboard controller regained\t")
SETPOINT_INVALID = _plain(0x15637A5, 0x33, _CRITICAL, "SET_POSITION_TARGET_LOCAL_NED invalid\t")

NAMES: dict[int, str] = {
    0x102089D: "commander_arm_denied_resolve_failures",
    0x102D3AA: "rtl_land_at_destination",
    0x10EAC3F: "failsafe_rc_override",
    0x1125BEF: "logger_open_file_time",
    0x128180B: "check_battery_critical",
    0x132B2DE: "commander_landing_current_pos",
    0x13B2FC7: "navigator_takeoff_default_alt",
    0x13E092F: "check_gf_violation_max_hor_dist",
    0x1414569: "commander_takeoff_detected",
    0x144B3E0: "commander_failsafe_enter_generic_hold",
    0x14D0DA4: "check_battery_low",
    0x1522694: "vrtl_return_at",
    0x15637A5: "mavlink_rcv_sp_target_invalid",
    0x159387D: "commander_low_bat_shutdown_failed",
    0x167C97B: "check_rc_dl_no_dllink",
    0x18AB9B5: "commander_disarm_denied_not_landed",
    0x190CAF3: "commander_armed_by",
    0x194CA8A: "commander_failsafe_enter",
    0x19638AC: "commander_landing_detected",
    0x1A04397: "commander_modeswitch_not_avail",
    0x1A3870B: "commander_onboard_ctrl_regained",
    0x1A4B458: "commander_gcs_lost",
    0x1A9B99D: "commander_mission_comp_lost",
    0x1AD1B07: "check_battery_emergency",
    0x1AF6FD6: "check_estimator_gps_vert_pos_drift_too_high",
    0x1BA6953: "commander_failsafe_enter_low_bat",
    0x1BCBE91: "check_estimator_gps_fix_too_low",
    0x1C2DC72: "commander_failsafe_enter_autopilot_disengaged",
    0x1CA98D9: "commander_failsafe_enter_generic_warn",
    0x1CB9E5A: "check_battery_unhealthy",
    0x1D11DF6: "commander_failsafe_enter_hold",
    0x1D93424: "commander_dl_regained",
    0x1DEDBD0: "commander_failsafe_enter_generic",
    0x1E04AA7: "check_estimator_gnss_fusion_stopped",
    0x1E95843: "check_estimator_gnss_fusion_started",
    0x1F46777: "commander_disarmed_by",
    0x1FDF2ED: "check_estimator_heading_not_stable",
}


def armed() -> Announcement:
    """Return the announcement that the vehicle was armed by a command."""
    return Announcement(0x190CAF3, 0x66, bytes([By.COMMAND]), _INFO, f"Armed by {_BY[By.COMMAND]}\t")


def disarmed(by: By) -> Announcement:
    """Return the announcement that the vehicle was disarmed, with the cause."""
    return Announcement(0x1F46777, 0x66, bytes([by]), _INFO, f"Disarmed by {_BY[by]}\t")


def log_opened(utc: tuple[int, int, int, int, int, int]) -> Announcement:
    """Return the announcement that the flight's log file was opened. ``utc``: year, month, day, hours, minutes, seconds."""
    year, month, day, hours, minutes, seconds = utc
    file = f"./log/{year}-{month:02}-{day:02}/{hours:02}_{minutes:02}_{seconds:02}.ulg"
    return Announcement(0x1125BEF, 0x66, struct.pack("<HBBBBB", *utc), _INFO, f"[logger] {file}\t")


def takeoff_height(height_m: float) -> Announcement:
    """Return the announcement of a takeoff to the default height, as none was commanded."""
    text = f"Using default takeoff altitude: {height_m:.1f} m\t"
    return Announcement(0x13B2FC7, 0x66, struct.pack("<f", height_m), _INFO, text)


def unavailable(mode: Mode) -> Announcement:
    """Return the announcement that a mode cannot be chosen now, because something is missing."""
    text = f"Switching to {mode.name.title()} is currently not available\t"
    number = {Mode.POSITION: 2, Mode.ALTITUDE: 1, Mode.STABILIZED: 8}.get(mode, 0)
    return Announcement(0x1A04397, 0x62, struct.pack("<IB", mode.custom_mode, number), _CRITICAL, text)


def unhealthy(reason: str) -> Announcement:
    """Return the announcement of a check that never passes; PX4 has no single event for these."""
    return Announcement(None, 0, b"", _CRITICAL, f"Preflight Fail: {reason}")


def return_begins(altitude_m: float, above_m: float) -> Announcement:
    """Return the announcement that a return begins, with the altitude above the sea and above the destination, metres."""
    altitude, above = round(altitude_m), round(above_m)
    text = f"RTL: start return at {altitude} m ({above} m above destination)\t"
    return Announcement(0x1522694, 0x66, struct.pack("<ib", altitude, max(-128, min(above, 127))), _INFO, text)


def hold_first(intended: Mode, action: Action, seconds: float, cause: Cause) -> Announcement:
    """Return the announcement of a failsafe that holds for some seconds before it acts."""
    text = f"Failsafe activated: entering Hold for {seconds:.0f} seconds\t"
    arguments = struct.pack("<IBH", intended.custom_mode, action, round(seconds))
    if cause is Cause.GENERIC:
        return Announcement(0x144B3E0, 0x42, arguments, _CRITICAL, text)
    return Announcement(0x1D11DF6, 0x42, arguments + bytes([cause]), _CRITICAL, text)


def failsafe(intended: Mode, action: Action, cause: Cause) -> Announcement:
    """Return the announcement of a failsafe that acts."""
    arguments, text = struct.pack("<IB", intended.custom_mode, action), "Failsafe activated\t"
    if action is Action.DESCEND:
        return Announcement(0x1C2DC72, 0x42, arguments, _CRITICAL, text)
    if cause is Cause.GENERIC:
        return Announcement(0x1DEDBD0, 0x42, arguments, _CRITICAL, text)
    return Announcement(0x194CA8A, 0x42, arguments + bytes([cause]), _CRITICAL, text)
