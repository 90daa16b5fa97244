"""The MAVLink messages that the agent reads, with MAVLink's fields and units, as in MavlinkDirect's JSON: NaN is null."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta, Struct

Bytes = tuple[Annotated[int, Meta(ge=0, le=255)], ...]

_KINDS = {0: " (development)", 64: " (alpha)", 128: " (beta)", 192: " (release candidate)"}  # FIRMWARE_VERSION_TYPE


class Heartbeat(Struct, frozen=True):
    """HEARTBEAT: mode, armed flag, and system status of the autopilot, sent once a second."""

    base_mode: int
    custom_mode: int
    system_status: int


class LocalPosition(Struct, frozen=True):
    """LOCAL_POSITION_NED: position (m) and velocity (m/s) from the origin of the autopilot's position filter."""

    time_boot_ms: int
    x: float | None
    y: float | None
    z: float | None
    vx: float | None
    vy: float | None
    vz: float | None


class Attitude(Struct, frozen=True):
    """ATTITUDE_QUATERNION: attitude of the body (FRD) in the world (NED), with body rates (rad/s)."""

    time_boot_ms: int
    q1: float | None
    q2: float | None
    q3: float | None
    q4: float | None
    rollspeed: float | None  # rad/s, body
    pitchspeed: float | None
    yawspeed: float | None


class Odometry(Struct, frozen=True):
    """ODOMETRY, of which only the count of resets of the autopilot's position filter (modulo 256) is read."""

    time_usec: int  # since boot
    reset_counter: int


class GpsRaw(Struct, frozen=True):
    """GPS_RAW_INT: position of a satellite receiver in 1e-7 degrees, heights and accuracies in millimetres."""

    time_usec: int  # since boot
    fix_type: int  # GPS_FIX_TYPE: 3 or more is a position
    lat: int
    lon: int
    alt_ellipsoid: int = 0
    h_acc: int = 0  # 1 sigma; 0 unknown
    v_acc: int = 0


class TimeSync(Struct, frozen=True):
    """TIMESYNC: times in nanoseconds by which two computers compare their clocks; ``tc1`` is 0 in a request."""

    tc1: int
    ts1: int


class ExtendedState(Struct, frozen=True):
    """EXTENDED_SYS_STATE: whether the vehicle is on the ground, taking off, in the air or landing."""

    landed_state: int


class SystemStatus(Struct, frozen=True):
    """SYS_STATUS: sensors that are present, enabled and healthy, as bits of MAV_SYS_STATUS_SENSOR, and the battery's level."""

    onboard_control_sensors_present: int
    onboard_control_sensors_enabled: int
    onboard_control_sensors_health: int
    battery_remaining: int  # percent, -1 unknown


class DistanceSensor(Struct, frozen=True):
    """DISTANCE_SENSOR: measurement of a rangefinder, centimetres along the sensor's axis."""

    min_distance: int
    max_distance: int
    current_distance: int
    orientation: int
    signal_quality: int = 0  # percent; 0 unknown, 1 invalid


class Battery(Struct, frozen=True):
    """BATTERY_STATUS: level of one of the vehicle's batteries."""

    id: int
    battery_remaining: int  # percent, -1 unknown


class EstimatorStatus(Struct, frozen=True):
    """ESTIMATOR_STATUS: health of the autopilot's position filter.

    Accuracies are standard deviations (m); ``flags`` are bits of ESTIMATOR_STATUS_FLAGS; ratios are innovations (measured minus
    predicted) over the limits beyond which the filter rejects a measurement.
    """

    pos_horiz_accuracy: float | None
    pos_vert_accuracy: float | None
    flags: int = 0x3FF
    pos_horiz_ratio: float | None = 0.0  # NaN: satellites are not fused
    vel_ratio: float | None = 0.0


class CurrentMode(Struct, frozen=True):
    """CURRENT_MODE: the autopilot's mode; ``intended_custom_mode``: the mode that follows after a failsafe; 0 unknown."""

    custom_mode: int
    intended_custom_mode: int = 0


class HomePosition(Struct, frozen=True):
    """HOME_POSITION: the place to which the autopilot returns; the agent only reads whether the autopilot has one."""

    latitude: int
    longitude: int


class GlobalOrigin(Struct, frozen=True):
    """GPS_GLOBAL_ORIGIN: geodetic origin of the autopilot's local frame, 1e-7 degrees and millimetres."""

    latitude: int
    longitude: int
    altitude: int


class StatusText(Struct, frozen=True):
    """STATUSTEXT: a text of the autopilot for the operator, or one chunk of a longer text."""

    severity: int
    text: str
    id: int = 0
    chunk_seq: int = 0


class Event(Struct, frozen=True):
    """EVENT: an event of the autopilot as number and arguments; the text is in the autopilot's own list of events."""

    id: int
    log_levels: int
    arguments: Bytes
    sequence: int = 0


class CommandAck(Struct, frozen=True):
    """COMMAND_ACK: the autopilot's answer to a command."""

    command: int
    result: int


class ParameterValue(Struct, frozen=True):
    """PARAM_VALUE: name, value and type of one parameter of the autopilot."""

    param_id: str
    param_value: float | None
    param_type: int


class ParameterError(Struct, frozen=True):
    """PARAM_ERROR: the requested parameter does not exist, or was not set."""

    param_id: str
    error: int


class AutopilotVersion(Struct, frozen=True):
    """AUTOPILOT_VERSION: version of the autopilot's firmware.

    ``flight_sw_version`` has major, minor, patch and kind in a byte each; ``flight_custom_version`` holds the first eight bytes
    of the source's commit, the last byte first.
    """

    flight_sw_version: int
    flight_custom_version: Bytes = ()

    @property
    def text(self) -> str:
        """The firmware's version with its commit, such as ``PX4 1.15.4 (beta), 1a2b3c4d``."""
        commit = bytes(reversed(self.flight_custom_version))[:4]
        return f"PX4 {self.number}" + (f", {commit.hex()}" if any(commit) else "")

    @property
    def number(self) -> str:
        """The firmware's version number, such as ``1.15.4 (beta)``."""
        major, minor, patch, kind = self.flight_sw_version.to_bytes(4, "big")
        return f"{major}.{minor}.{patch}{_KINDS.get(kind, '')}"

    @property
    def is_too_old(self) -> bool:
        """Whether the firmware is older than the agent supports. A build without a version (0.0.0) counts as new."""
        major, minor, _, _ = self.flight_sw_version.to_bytes(4, "big")
        return (0, 0) < (major, minor) < (1, 13)


Message = (
    Heartbeat
    | CurrentMode
    | Event
    | ParameterError
    | LocalPosition
    | Attitude
    | Odometry
    | GpsRaw
    | TimeSync
    | ExtendedState
    | SystemStatus
    | DistanceSensor
    | Battery
    | EstimatorStatus
    | HomePosition
    | GlobalOrigin
    | StatusText
    | CommandAck
    | ParameterValue
    | AutopilotVersion
)

DECODERS: dict[str, msgspec.json.Decoder[Message]] = {
    name: msgspec.json.Decoder(kind)
    for name, kind in {
        "HEARTBEAT": Heartbeat,
        "CURRENT_MODE": CurrentMode,
        "EVENT": Event,
        "PARAM_ERROR": ParameterError,
        "LOCAL_POSITION_NED": LocalPosition,
        "ATTITUDE_QUATERNION": Attitude,
        "ODOMETRY": Odometry,
        "GPS_RAW_INT": GpsRaw,
        "TIMESYNC": TimeSync,
        "EXTENDED_SYS_STATE": ExtendedState,
        "SYS_STATUS": SystemStatus,
        "DISTANCE_SENSOR": DistanceSensor,
        "BATTERY_STATUS": Battery,
        "ESTIMATOR_STATUS": EstimatorStatus,
        "HOME_POSITION": HomePosition,
        "GPS_GLOBAL_ORIGIN": GlobalOrigin,
        "STATUSTEXT": StatusText,
        "COMMAND_ACK": CommandAck,
        "PARAM_VALUE": ParameterValue,
        "AUTOPILOT_VERSION": AutopilotVersion,
    }.items()
}
