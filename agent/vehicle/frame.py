"""Conversions between the autopilot's frames (local NED, body FRD) and the agent's (local ENU, body FLU).

The agent's local frame has its origin at the launch place; its axes are east, north, up.
"""

from __future__ import annotations

from math import hypot, pi, sqrt

from radron.agent.geometry import Quaternion, Vector3, yaw_of
from radron.agent.vehicle.interface import LaunchPlace

_HALF = sqrt(0.5)


def enu_from_ned(vector: Vector3) -> Vector3:
    """Convert a direction, velocity or acceleration from NED to ENU axes; the conversion is its own inverse."""
    north, east, down = vector
    return east, north, -down


ned_from_enu = enu_from_ned


def enu_from_ned_position(position_m: Vector3, launch: LaunchPlace) -> Vector3:
    """Convert a position (m) from the autopilot's local frame (NED) to the agent's (ENU from the launch place)."""
    north, east, down = position_m
    return east - launch.east_m, north - launch.north_m, launch.down_m - down


def ned_from_enu_position(position_m: Vector3, launch: LaunchPlace) -> Vector3:
    """Convert a position (m) from the agent's local frame (ENU from the launch place) to the autopilot's (NED)."""
    east, north, up = position_m
    return north + launch.north_m, east + launch.east_m, launch.down_m - up


def enu_from_flu(quaternion: Quaternion) -> Quaternion:
    """Convert an attitude of the autopilot (body FRD in world NED) to the agent's axes (body FLU in world ENU).

    The product is (ENU <- NED) * q * (FRD <- FLU), with the half turns (0, 1, 1, 0) / sqrt(2) and (0, 1, 0, 0), multiplied out.
    """
    w, x, y, z = quaternion
    return _HALF * (w + z), _HALF * (x + y), _HALF * (x - y), _HALF * (w - z)


frd_from_flu = enu_from_flu  # the attitude NED <- FRD from ENU <- FLU: the half turns cancel


def turned_on(quaternion: Quaternion, rates_rps: Vector3, time_s: float) -> Quaternion:
    """Return the attitude a short time later, when the body turns at these rates (rad/s), to second order in the angle."""
    w, x, y, z = quaternion
    a, b, c = (0.5 * rate * time_s for rate in rates_rps)
    turned = (w - x * a - y * b - z * c, x + w * a + y * c - z * b, y + w * b - x * c + z * a, z + w * c + x * b - y * a)
    length = hypot(*turned)
    return turned[0] / length, turned[1] / length, turned[2] / length, turned[3] / length


def up_share(quaternion: Quaternion) -> float:
    """Return the cosine of the tilt, the angle between the body's and the world's vertical; equal for NED <- FRD and ENU
    <- FLU.
    """
    _, x, y, _ = quaternion
    return 1.0 - 2.0 * (x * x + y * y)


def heading(quaternion: Quaternion, rates_rps: Vector3) -> tuple[float, float]:
    """Return the heading (rad) of an attitude, and the rate of the heading (rad/s) at these body rates, in the frames of the
    attitude.
    """
    w, x, y, z = quaternion
    side, up = 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)  # of the vertical, along the body's second and third axis
    return yaw_of(quaternion), (side * rates_rps[1] + up * rates_rps[2]) / max(0.01, side * side + up * up)


def ned_yaw(yaw_rad: float) -> float:
    """Convert a heading from east, counter-clockwise, to a heading from north, clockwise, in (-pi, pi], both in rad."""
    turned = pi / 2 - yaw_rad
    return pi - (pi - turned) % (2 * pi)
