"""The MAVLink messages that the agent reads, with their own fields and units, as MavlinkDirect's JSON has them: NaN is null."""

from __future__ import annotations

import msgspec
from msgspec import Struct


class Heartbeat(Struct, frozen=True):
    """Mode, armed flag, and system status."""

    base_mode: int
    custom_mode: int
    system_status: int


class LocalPosition(Struct, frozen=True):
    """LOCAL_POSITION_NED: metres, m/s, from the estimator's own origin."""

    time_boot_ms: int
    x: float | None
    y: float | None
    z: float | None
    vx: float | None
    vy: float | None
    vz: float | None


class Attitude(Struct, frozen=True):
    """ATTITUDE_QUATERNION: NED <- FRD."""

    time_boot_ms: int
    q1: float | None
    q2: float | None
    q3: float | None
    q4: float | None
    rollspeed: float | None  # rad/s, body
    pitchspeed: float | None
    yawspeed: float | None


class Odometry(Struct, frozen=True):
    """ODOMETRY: of all that it says, how often the estimator has been reset by then (modulo 256)."""

    time_usec: int  # since boot
    reset_counter: int


class GpsRaw(Struct, frozen=True):
    """GPS_RAW_INT: what a satellite receiver says; 1e-7 degrees, millimetres."""

    time_usec: int  # since boot
    fix_type: int  # GPS_FIX_TYPE: 3 or more is a position
    lat: int
    lon: int
    alt_ellipsoid: int = 0
    h_acc: int = 0  # 1 sigma; 0 unknown
    v_acc: int = 0


class TimeSync(Struct, frozen=True):
    """TIMESYNC: nanoseconds; ``tc1`` is 0 in a request."""

    tc1: int
    ts1: int


class ExtendedState(Struct, frozen=True):
    """EXTENDED_SYS_STATE."""

    landed_state: int


class SystemStatus(Struct, frozen=True):
    """SYS_STATUS: bits of MAV_SYS_STATUS_SENSOR."""

    onboard_control_sensors_present: int
    onboard_control_sensors_enabled: int
    onboard_control_sensors_health: int
    battery_remaining: int  # percent, -1 unknown


class DistanceSensor(Struct, frozen=True):
    """DISTANCE_SENSOR: centimetres along the sensor's axis."""

    min_distance: int
    max_distance: int
    current_distance: int
    orientation: int
    signal_quality: int = 0  # percent; 0 unknown, 1 invalid


class Battery(Struct, frozen=True):
    """BATTERY_STATUS."""

    id: int
    battery_remaining: int  # percent, -1 unknown


class EstimatorStatus(Struct, frozen=True):
    """ESTIMATOR_STATUS: standard deviations, metres."""

    pos_horiz_accuracy: float | None
    pos_vert_accuracy: float | None


class HomePosition(Struct, frozen=True):
    """HOME_POSITION: that there is one is what counts."""

    latitude: int
    longitude: int


class GlobalOrigin(Struct, frozen=True):
    """GPS_GLOBAL_ORIGIN of the local frame: 1e-7 degrees, millimetres."""

    latitude: int
    longitude: int
    altitude: int


class StatusText(Struct, frozen=True):
    """STATUSTEXT, or one chunk of a longer one."""

    severity: int
    text: str
    id: int = 0
    chunk_seq: int = 0


class CommandAck(Struct, frozen=True):
    """COMMAND_ACK."""

    command: int
    result: int


class ParameterValue(Struct, frozen=True):
    """PARAM_VALUE."""

    param_id: str
    param_value: float | None
    param_type: int


Message = (
    Heartbeat
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
)

DECODERS: dict[str, msgspec.json.Decoder[Message]] = {
    name: msgspec.json.Decoder(kind)
    for name, kind in {
        "HEARTBEAT": Heartbeat,
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
    }.items()
}
