"""Schedule of the messages that a vehicle sends on a link: PX4's onboard and ground-station sets, changed on request."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from radron.sim.vehicle.px4.mavlink import status, telemetry
from radron.sim.vehicle.px4.mavlink.dialect import CurrentEventSequence, CurrentMode, ProtocolVersion
from radron.sim.vehicle.px4.state import Builder

BUILDERS: dict[int, Builder] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: status.heartbeat,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: telemetry.attitude,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: telemetry.attitude_quaternion,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: telemetry.local_position,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: telemetry.global_position,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: telemetry.gps_raw,
    mavlink.MAVLINK_MSG_ID_ODOMETRY: telemetry.odometry,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: telemetry.highres_imu,
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: telemetry.scaled_pressure,
    mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR: telemetry.distance_sensor,
    mavlink.MAVLINK_MSG_ID_ALTITUDE: telemetry.altitude,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: telemetry.vfr_hud,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: telemetry.servo_output,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: telemetry.attitude_target,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: telemetry.position_target,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: status.extended_sys_state,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: status.sys_status,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: status.battery_status,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: status.home_position,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: status.gps_global_origin,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: status.estimator_status,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: status.system_time,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: status.timesync,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: status.mission_current,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: status.autopilot_version,
    mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: telemetry.hil_state,
    CurrentMode.id: status.current_mode,
    CurrentEventSequence.id: status.current_event_sequence,
    ProtocolVersion.id: status.protocol_version,
}

ONBOARD_HZ: dict[int, float] = {
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 100.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 50.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 50.0,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: 50.0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 30.0,
    mavlink.MAVLINK_MSG_ID_ODOMETRY: 30.0,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 10.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 10.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: 10.0,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 10.0,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: 10.0,
    mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR: 10.0,
    mavlink.MAVLINK_MSG_ID_ALTITUDE: 10.0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 8.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 5.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5.0,
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: 1.0,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 1.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
    CurrentMode.id: 0.5,
    CurrentEventSequence.id: 0.33,
}

GROUND_STATION_HZ: dict[int, float] = {
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 50.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 50.0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 50.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 50.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: 50.0,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 50.0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 5.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 4.0,
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
    CurrentMode.id: 0.5,
    CurrentEventSequence.id: 0.33,
}

HEARTBEAT_LATE_S, HEARTBEAT_SELDOM_S, SELDOM = (-0.005, 0.018), (0.02, 0.1), 0.005  # recorded: 0.98 to 1.11 s between two
MAX_INTERVAL_S = 2**31 * 1e-6  # longest interval in MESSAGE_INTERVAL; at a longer one a message is off
_HEARTBEAT = mavlink.MAVLINK_MSG_ID_HEARTBEAT
_EARLY_S = 1e-6  # tolerance for rounding, of the time of a step


class Schedule:
    """Determines when each message of one link is sent, in seconds of the vehicle's clock.

    Each message has its own fixed interval, regardless of its content.
    """

    def __init__(self, rates_hz: dict[int, float], begin_s: float, rng: np.random.Generator) -> None:
        """``rates_hz``: usual rate of each message. Nothing is sent before ``begin_s``; every message begins within one of its
        intervals from then on.
        """
        self._usual = {message: 1.0 / rate for message, rate in rates_hz.items()}
        self._interval = dict(self._usual)
        self.beat_s = float("-inf")  # of the last heartbeat
        self.muted: set[int] = set()  # messages suppressed by a fault
        self._rng = rng
        self._next = {message: begin_s + float(rng.uniform(0.0, interval)) for message, interval in self._usual.items()}

    def due(self, now_s: float) -> Iterator[Builder]:
        """Yield the functions that build the messages due by now; missed messages are not repeated."""
        limit_s = now_s + _EARLY_S
        for message, next_s in self._next.items():
            if next_s <= limit_s:
                interval_s = self._interval[message]
                late = next_s + interval_s <= limit_s
                self._next[message] = now_s + interval_s if late else next_s + interval_s
                if message == _HEARTBEAT:
                    self._next[message] += self._delay_s()
                    self.beat_s = now_s
                if message not in self.muted:
                    yield BUILDERS[message]

    def _delay_s(self) -> float:
        """Delay of a heartbeat beyond its second."""
        return float(self._rng.uniform(*(HEARTBEAT_SELDOM_S if self._rng.random() < SELDOM else HEARTBEAT_LATE_S)))

    def interval_us(self, message: int) -> int:
        """Return the interval of a message as in MESSAGE_INTERVAL: microseconds, -1 for a message that is not sent."""
        interval_s = self._interval.get(message)
        return -1 if interval_s is None else round(interval_s * 1e6)

    def set_interval(self, message: int, interval_us: float, now_s: float) -> bool:
        """Apply SET_MESSAGE_INTERVAL: -1 off, 0 the default, else microseconds.

        Return False for a message unknown to this vehicle, and for the heartbeat, whose rate is fixed in PX4.
        """
        if message not in BUILDERS or message == _HEARTBEAT:
            return False
        interval_s = self._usual.get(message) if interval_us == 0.0 else interval_us * 1e-6
        if interval_s is None or not 0.0 <= interval_s <= MAX_INTERVAL_S:
            self._interval.pop(message, None)
            self._next.pop(message, None)
        else:
            self._interval[message] = interval_s
            self._next[message] = now_s + interval_s
        return True
