"""PX4's events: the link carries a number, levels and the bytes of the arguments; the texts are here.

The number of an event is a hash of its name. Names, texts and layouts are of PX4 1.17, as far as useful to an operator. Nearly
all have been seen on a real PX4. Events are sent on every link, STATUSTEXT only on links with messages of a ground station.

PX4 reports whether it can be armed whenever that changes: a summary, an event for each failed check with the modes that it bars,
and another summary.
"""

from __future__ import annotations

import struct

from msgspec import Struct

from radron.agent.vehicle.interface import FlightMode
from radron.agent.vehicle.mavlink.messages import Event

_EXTERNAL = 0x0F  # of log_levels: MAV_SEVERITY for operators; the other half is for the vehicle's own log
_PX4 = 1 << 24  # the component id, above the hash of the name
FAILSAFE = "Failsafe: "
_ACTIONS = {1: "warning", 5: "hold", 6: "return", 7: "land", 8: "descend", 9: "disarm", 10: "terminate"}
_CAUSES = {
    1: "remote control lost",
    2: "ground station lost",
    3: "battery low",
    4: "battery critically low",
    5: "battery nearly empty",
    6: "too little flight time left",
}
# Bits of the modes that a check bars; a manual mode may be any of three.
_BITS = {
    FlightMode.MANUAL: 0b111,
    FlightMode.HOLD: 1 << 4,
    FlightMode.RETURN: 1 << 5,
    FlightMode.OFFBOARD: 1 << 14,
    FlightMode.TAKEOFF: 1 << 17,
    FlightMode.LAND: 1 << 18,
}


class _Text(Struct, frozen=True):
    """A text with placeholders, and the byte at which each argument begins."""

    text: str
    action: int | None = None  # uint8
    cause: int | None = None  # uint8
    delay: int | None = None  # uint16, seconds


_TEXTS = {
    "commander_arm_denied_resolve_failures": _Text("Arming denied: Resolve system health failures first"),
    "commander_disarm_denied_not_landed": _Text("Disarming denied: not landed"),
    "commander_failsafe_enter": _Text(FAILSAFE + "{cause}: {action}", action=4, cause=5),
    "commander_failsafe_enter_autopilot_disengaged": _Text(FAILSAFE + "{action}", action=4),
    "commander_failsafe_enter_generic": _Text(FAILSAFE + "{action}", action=4),
    "commander_failsafe_enter_generic_hold": _Text(FAILSAFE + "{action} in {delay} s", action=4, delay=5),
    "commander_failsafe_enter_generic_warn": _Text("Failsafe warning"),
    "commander_failsafe_enter_hold": _Text(FAILSAFE + "{cause}: {action} in {delay} s", action=4, delay=5, cause=7),
    "commander_failsafe_enter_low_bat": _Text("Low battery level, return advised"),
    "commander_gcs_lost": _Text("Connection to ground control station lost"),
    "commander_low_bat_shutdown_failed": _Text("Dangerously low battery"),
    "commander_mission_comp_lost": _Text("Connection to mission computer lost"),
    "commander_modeswitch_not_avail": _Text("Switching to another mode is currently not possible"),
    "failsafe_rc_override": _Text("Pilot took over using sticks"),
    "mavlink_rcv_sp_target_invalid": _Text("Setpoint invalid: neither position nor velocity nor acceleration"),
    "sensor_failover_mag": _Text("Magnetometer failure"),
}
_CHECKS = {
    "check_baro_no_data": "No valid data from barometer",
    "check_battery_critical": "Critical battery",
    "check_battery_emergency": "Emergency battery level",
    "check_battery_low": "Low battery",
    "check_battery_unhealthy": "Battery unhealthy",
    "check_estimator_gps_fix_too_low": "GPS fix too low",
    "check_estimator_gps_vert_pos_drift_too_high": "GPS Vertical Position Drift too high",
    "check_estimator_heading_not_stable": "Heading estimate not stable",
    "check_gf_violation_max_hor_dist": "Geofence violation: exceeding maximum distance to Home",
    "check_mag_no_data": "No valid data from compass",
    "check_modes_angular_velocity": "Angular velocity not valid",
    "check_modes_attitude": "No valid attitude estimate",
    "check_modes_cannot_takeoff": "Mode not suitable for arming",
    "check_modes_global_pos": "No valid global position estimate",
    "check_modes_home_position": "Home position not set",
    "check_modes_local_alt": "No valid altitude estimate",
    "check_modes_local_pos": "No valid position estimate",
    "check_modes_offboard_signal": "No offboard signal",
    "check_rc_dl_no_dllink": "No connection to the ground control station",
}
_NOT_REPORTED = ("check_modes_manual_control",)  # always fails without a remote control


def number_of(name: str) -> int:
    """Return the number by which PX4 sends the event with this name: the FNV-1a hash of the name, truncated."""
    value = 0x811C9DC5
    for byte in name.encode():
        value = (value ^ byte) * 0x01000193 & 0xFFFF_FFFF
    return _PX4 | value & 0xFF_FFFF


REPORT_BEGINS, REPORT_ENDS = number_of("commander_arming_check_summary"), number_of("commander_health_summary")
_BY_NUMBER = {number_of(name): known for name, known in _TEXTS.items()}
_CHECK_BY_NUMBER = {number_of(name): text for name, text in _CHECKS.items()}
_SILENT = {number_of(name) for name in _NOT_REPORTED}


class FailedCheck(Struct, frozen=True):
    """A failed check of the autopilot, which prevents arming in some flight modes.

    ``modes``: those modes, as PX4's bits.
    """

    text: str
    modes: int

    def bars(self, mode: FlightMode) -> bool:
        """Return whether the autopilot's failed check prevents arming in this flight mode."""
        return bool(self.modes & _BITS[mode])


def severity(event: Event) -> int:
    """Return the severity of an autopilot event for operators, as MAV_SEVERITY; smaller is worse."""
    return event.log_levels & _EXTERNAL


def failed_check(event: Event) -> FailedCheck | None:
    """Return the failed check that an event of the autopilot's health report names, also if its text is not known here.

    Return None if the event names no failed check.
    """
    if event.id in _SILENT or len(event.arguments) < 4:
        return None
    text = _CHECK_BY_NUMBER.get(event.id, f"check {event.id:#x} (see the list of events of this PX4 version)")
    return FailedCheck(text, int.from_bytes(bytes(event.arguments[:4]), "little"))


def text_of(event: Event) -> str | None:
    """Return the text of an autopilot event that is not part of a health report; None if the event is not known here."""
    known = _BY_NUMBER.get(event.id)
    if known is None:
        return _CHECK_BY_NUMBER.get(event.id)
    data = bytes(event.arguments)
    action, cause, delay = known.action, known.cause, known.delay
    return known.text.format(
        action=_named(_ACTIONS, data, action, "another action"),
        cause=_named(_CAUSES, data, cause, "another cause"),
        delay=struct.unpack_from("<H", data, delay)[0] if delay is not None and len(data) >= delay + 2 else "some",
    )


def _named(names: dict[int, str], data: bytes, place: int | None, otherwise: str) -> str:
    return names.get(data[place], otherwise) if place is not None and place < len(data) else otherwise
