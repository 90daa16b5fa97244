"""Offboard targets (setpoints of a companion computer) in MAVLink messages, and a record of their regularity."""

from __future__ import annotations

from array import array
from math import isfinite, nan, pi
from typing import NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from radron.sim.geometry import Vector3

_YAW_IGNORED, _YAW_RATE_IGNORED = 1024, 2048


class OffboardTarget(NamedTuple):
    """A setpoint of a companion computer in the vehicle's local frame, ENU; missing values are NaN."""

    position_m: Vector3
    velocity_mps: Vector3
    acceleration_mps2: Vector3
    yaw_rad: float
    yaw_rate_rps: float


def offboard_target(message: mavlink.MAVLink_set_position_target_local_ned_message) -> OffboardTarget | None:
    """Return the setpoint in a message of frame LOCAL_NED; None without any value, or with values that are not finite."""
    mask = message.type_mask
    x, y, z = _given(mask, (message.x, message.y, message.z))
    vx, vy, vz = _given(mask >> 3, (message.vx, message.vy, message.vz))
    ax, ay, az = _given(mask >> 6, (message.afx, message.afy, message.afz))
    if not any(map(isfinite, (x, y, z, vx, vy, vz, ax, ay, az))):
        return None
    yaw = nan if mask & _YAW_IGNORED else pi / 2.0 - message.yaw
    yaw_rate = nan if mask & _YAW_RATE_IGNORED else -message.yaw_rate
    return OffboardTarget((y, x, -z), (vy, vx, -vz), (ay, ax, -az), yaw, yaw_rate)


def _given(mask: int, values: Vector3) -> Vector3:
    x, y, z = values
    return (nan if mask & 1 else x, nan if mask & 2 else y, nan if mask & 4 else z)


class SetpointLog:
    """Records when position setpoints arrive; a setpoint that repeats the one before was not newly computed.

    received: number of all setpoints. computed: number of setpoints that differ from the one before. largest_gap_s: longest time
    between two computed ones in offboard mode. gaps_s: all of these times in order.
    """

    def __init__(self) -> None:
        self.received = self.computed = 0
        self.largest_gap_s = 0.0
        self.gaps_s = array("d")
        self._content = b""
        self._last_ns: int | None = None

    def add(self, payload: bytes, arrival_ns: int, offboard: bool) -> None:
        """Record a setpoint by its payload, whose first four bytes are the sender's time."""
        self.received += 1
        if payload[4:] == self._content:
            return
        self._content = payload[4:]
        self.computed += 1
        if offboard and self._last_ns is not None:
            self.gaps_s.append((arrival_ns - self._last_ns) * 1e-9)
            self.largest_gap_s = max(self.largest_gap_s, self.gaps_s[-1])
        self._last_ns = arrival_ns if offboard else None

    def leave_offboard(self) -> None:
        """Begin a new series: the next setpoint does not continue the earlier ones."""
        self._last_ns = None
