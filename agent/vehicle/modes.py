"""PX4's modes and states as its heartbeat and EXTENDED_SYS_STATE carry them (px4_custom_mode.h, MAVLink common)."""

from __future__ import annotations

from radron.agent.vehicle.interface import FlightMode
from radron.agent.vehicle.requests import Act

ARMED = 0x80  # MAV_MODE_FLAG_SAFETY_ARMED in base_mode
SET_MODE_FLAGS = 0x81  # armed and custom mode enabled: first parameter of DO_SET_MODE, as MAVSDK gives it
STANDBY, ACTIVE, CRITICAL = 3, 4, 5  # MAV_STATE; PX4 says CRITICAL in a failsafe
IN_AIR, LANDING = 2, 4  # MAV_LANDED_STATE

_AUTO, _OFFBOARD = 4, 6
_AUTO_MODES = {
    1: FlightMode.HOLD,  # ready: before the first takeoff
    2: FlightMode.TAKEOFF,
    3: FlightMode.HOLD,
    5: FlightMode.RETURN,
    6: FlightMode.LAND,
    9: FlightMode.LAND,  # precision landing
}
# Main and sub mode, as DO_SET_MODE takes them.
CUSTOM_MODES = {Act.OFFBOARD: (_OFFBOARD, 0), Act.HOLD: (_AUTO, 3), Act.RETURN: (_AUTO, 5)}


def flight_mode(custom_mode: int) -> FlightMode:
    """Return the flight mode in the field ``custom_mode`` of a heartbeat. Missions and other modes of foreign control count as
    MANUAL.
    """
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    if main == _OFFBOARD:
        return FlightMode.OFFBOARD
    return _AUTO_MODES.get(sub, FlightMode.MANUAL) if main == _AUTO else FlightMode.MANUAL


def is_in_air(landed_state: int) -> bool:
    """Whether the vehicle flies and its takeoff is over.

    This is judged by the landed state alone, because the mode in the heartbeat may be a second earlier or later.
    """
    return landed_state in (IN_AIR, LANDING)
