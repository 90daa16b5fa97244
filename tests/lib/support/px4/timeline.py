"""Traffic on a vehicle's link, decoded: timelines of a real PX4's recordings, and of an emulated one, by the same code."""

from __future__ import annotations

import math
import struct
from collections import Counter
from collections.abc import Callable
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from radron.sim.vehicle.px4.mavlink import dialect

Row = list[Any]
DISTURBED = ("D_gps_loss", "D_ekf")  # recordings with errors and accuracies kept
_SUMMARY_LEVELS = 0x88  # of events that sum up the arming checks
_SUMMARIES = (0x105C2D9, 0x106ED29, 0x12F1DC7, 0x198C273, 0x1D31BB9)  # and these: the modes that a check bars, and the like
_AUTOPILOT = 1
_IGNORED_BITS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 11)  # position, velocity, acceleration, yaw, yaw rate
_METRES_PER_DEGREE = 111_194.9


class Packet(NamedTuple):
    """A line of a recording."""

    time_us: int
    system: int
    component: int
    number: int
    data: bytes


class Timeline:
    """Traffic on a vehicle's link, packet by packet. ``name``: of the recording.

    rows, setpoints: as ``extract_timelines`` describes them.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.rows: list[Row] = []
        self.setpoints: list[Row] = []
        self.system = 0
        self._counts: Counter[int] = Counter()
        self._last: dict[str, Row] = {}
        self._parser = mavlink.MAVLink(None)
        self._disturbed = self.name.startswith(DISTURBED)
        self._estimate: tuple[float, float, float] | None = None
        self._global_origin: tuple[float, float, float] | None = None
        self._begin_us: int | None = None
        self._ms = self._told_ms = 0

    def entry(self) -> dict[str, Any]:
        """As the file has it."""
        seconds = self._ms * 1e-3
        rates = {number: round(count / seconds, 3) for number, count in sorted(self._counts.items())}
        return {
            "name": self.name,
            "system": self.system,
            "duration_ms": self._ms,
            "rates_hz": rates,
            "rows": self.rows,
            "setpoints": self.setpoints,
        }

    def take(self, packet: Packet) -> None:
        """The next packet, either way; times count from the first."""
        if self._begin_us is None:
            self._begin_us = packet.time_us
        self._ms = round((packet.time_us - self._begin_us) / 1e3)
        ours = packet.component != _AUTOPILOT
        if not ours:
            self.system = packet.system
            self._counts[packet.number] += 1
        special = dialect.decode(packet.data)
        handlers = _SENT if ours else _CAME
        if special is None and packet.number not in handlers:
            return
        message = special or self._parser.decode(bytearray(packet.data))
        if special is not None:
            self._special(special)
        else:
            handlers[packet.number](self, message, packet)

    def _add(self, kind: str, *values: Any) -> None:
        self.rows.append([self._ms, kind, *values])

    def _change(self, kind: str, *values: Any) -> None:
        if self._last.get(kind) != list(values):
            self._last[kind] = list(values)
            self._add(kind, *values)

    # Sent to the vehicle

    def _beat(self, message: Any, packet: Packet) -> None:
        self._add("beat", packet.system, packet.component, message.type)

    def _command(self, message: Any, packet: Packet) -> None:
        by_int = message.get_type() == "COMMAND_INT"
        last = (message.x, message.y, message.z) if by_int else (message.param5, message.param6, message.param7)
        parameters = [message.param1, message.param2, message.param3, message.param4, *last]
        there = message.target_system == (self.system or packet.system)
        self._add(
            "command",
            message.command,
            _numbers(parameters),
            message.target_component,
            there,
            packet.system,
            packet.component,
            by_int,
        )

    def _param_set(self, message: Any, packet: Packet) -> None:
        self._add("param_set", message.param_id, _value(message.param_value, message.param_type), message.param_type)

    def _param_read(self, message: Any, packet: Packet) -> None:
        self._add("param_read", message.param_id, message.param_index)

    def _param_list(self, message: Any, packet: Packet) -> None:
        self._add("param_list")

    def _origin(self, message: Any, packet: Packet) -> None:
        self._add("origin", message.latitude, message.longitude, message.altitude)

    def _setpoint(self, message: Any, packet: Packet) -> None:
        names = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
        mask = message.type_mask
        asked = [getattr(message, name) for name, bit in zip(names, _IGNORED_BITS, strict=True) if not mask >> bit & 1]
        self.setpoints.append([self._ms, mask, *(None if math.isnan(value) else round(value * 1e3) for value in asked)])

    # Came from it

    def _heartbeat(self, message: Any, packet: Packet) -> None:
        self._change("heartbeat", message.custom_mode, message.base_mode, message.system_status)

    def _landed(self, message: Any, packet: Packet) -> None:
        self._change("landed", message.landed_state)

    def _ack(self, message: Any, packet: Packet) -> None:
        self._add("ack", message.command, message.result, message.target_system, message.target_component)

    def _text(self, message: Any, packet: Packet) -> None:
        self._add("text", message.severity, message.text, message.id, message.chunk_seq)

    def _param_error(self, message: Any, packet: Packet) -> None:
        name = message.param_id if message.param_id.isprintable() else None
        self._add("param_error", name, message.error)

    def _param_value(self, message: Any, packet: Packet) -> None:
        if self.name != "A_params_list":  # all 874: their names are in PX4's documentation
            self._add("param_value", message.param_id, _value(message.param_value, message.param_type), message.param_type)

    def _gps(self, message: Any, packet: Packet) -> None:
        self._change("fix", message.fix_type, message.satellites_visible)

    def _odometry(self, message: Any, packet: Packet) -> None:
        self._change("resets", message.reset_counter)

    def _global(self, message: Any, packet: Packet) -> None:
        self._global_origin = (message.latitude * 1e-7, message.longitude * 1e-7, message.altitude * 1e-3)
        self._add("global_origin", message.latitude, message.longitude, message.altitude)

    def _sensors(self, message: Any, packet: Packet) -> None:
        sensors = [getattr(message, f"onboard_control_sensors_{which}") for which in ("present", "enabled", "health")]
        self._change("sensors", *sensors)

    def _home(self, message: Any, packet: Packet) -> None:
        if "home" not in self._last:
            self._change("home", *(round(value, 3) for value in (message.x, message.y, message.z)))

    def _estimator(self, message: Any, packet: Packet) -> None:
        if self._disturbed:
            ratios = (message.vel_ratio, message.pos_horiz_ratio, message.pos_horiz_accuracy, message.pos_vert_accuracy)
            self._add("estimator", message.flags, *_numbers(ratios))
        else:
            self._change("estimator", message.flags)

    def _local(self, message: Any, packet: Packet) -> None:
        self._estimate = (message.x, message.y, message.z)
        if "place" not in self._last:
            self._change("place", *(round(value, 2) for value in self._estimate))

    def _truth(self, message: Any, packet: Packet) -> None:
        if not self._disturbed or self._estimate is None or self._global_origin is None or self._ms - self._told_ms < 500:
            return
        self._told_ms = self._ms
        latitude, longitude, altitude = self._global_origin
        north = (message.lat * 1e-7 - latitude) * _METRES_PER_DEGREE
        east = (message.lon * 1e-7 - longitude) * _METRES_PER_DEGREE * math.cos(math.radians(latitude))
        true = (north, east, altitude - message.alt * 1e-3)
        self._add("error", *(round(told - real, 2) for told, real in zip(self._estimate, true, strict=True)))

    def _special(self, message: Any) -> None:
        if isinstance(message, dialect.CurrentMode):
            self._change("mode", message.custom_mode, message.intended_custom_mode, message.standard_mode)
        elif isinstance(message, dialect.Event) and not _sums_up(message):
            self._add("event", message.event_id, message.log_levels, message.arguments.rstrip(b"\0").hex())


_Handler = Callable[[Timeline, Any, Packet], None]
_SENT: dict[int, _Handler] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: Timeline._beat,
    mavlink.MAVLINK_MSG_ID_COMMAND_LONG: Timeline._command,
    mavlink.MAVLINK_MSG_ID_COMMAND_INT: Timeline._command,
    mavlink.MAVLINK_MSG_ID_PARAM_SET: Timeline._param_set,
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ: Timeline._param_read,
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: Timeline._param_list,
    mavlink.MAVLINK_MSG_ID_SET_GPS_GLOBAL_ORIGIN: Timeline._origin,
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED: Timeline._setpoint,
}
_CAME: dict[int, _Handler] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: Timeline._heartbeat,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: Timeline._landed,
    mavlink.MAVLINK_MSG_ID_COMMAND_ACK: Timeline._ack,
    mavlink.MAVLINK_MSG_ID_STATUSTEXT: Timeline._text,
    mavlink.MAVLINK_MSG_ID_PARAM_ERROR: Timeline._param_error,
    mavlink.MAVLINK_MSG_ID_PARAM_VALUE: Timeline._param_value,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: Timeline._gps,
    mavlink.MAVLINK_MSG_ID_ODOMETRY: Timeline._odometry,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: Timeline._global,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: Timeline._sensors,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: Timeline._home,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: Timeline._estimator,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: Timeline._local,
    mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: Timeline._truth,
}


def _sums_up(event: Any) -> bool:
    return event.log_levels == _SUMMARY_LEVELS or event.event_id in _SUMMARIES


def _numbers(values: Any) -> list[float | None]:
    return [None if math.isnan(value) else float(f"{value:.9g}") for value in values]


def _value(wire: float, kind: int) -> float | int:
    """Of a parameter: an int32 goes as the bits of a float."""
    bits: int = struct.unpack("<i", struct.pack("<f", wire))[0]
    return bits if kind == mavlink.MAV_PARAM_TYPE_INT32 else float(f"{wire:.7g}")
