"""Setpoints to the autopilot: the mission's axes turned into PX4's, and a stream without gaps, which offboard mode needs."""

from __future__ import annotations

from math import isfinite

from radron.agent.vehicle.frame import ned_from_enu, ned_from_enu_position, ned_yaw
from radron.agent.vehicle.interface import LaunchPlace, Setpoint
from radron.agent.vehicle.mavlink.link import Link

LOCAL_NED = 1  # MAV_FRAME_LOCAL_NED
USE_ALL = 0  # type_mask: use position, velocity, acceleration, yaw and yaw rate
STREAM_S = 0.3  # setpoints are streamed for this long before offboard is requested
STREAM_GAP_S = 0.5  # after a longer gap the stream starts again


class SetpointStream:
    """Sends setpoints to the autopilot over one link; PX4 enters offboard mode only while a stream without gaps arrives."""

    def __init__(self, link: Link) -> None:
        """Start before the first setpoint. ``link``: to the autopilot."""
        self._link = link
        self._from_s = self._last_s = float("-inf")

    def send(self, setpoint: Setpoint, launch: LaunchPlace, now_s: float) -> bool:
        """Send a setpoint (in the pilot's local frame, ENU) to the autopilot; a setpoint that is not finite is counted and
        dropped.

        Args:
            setpoint: for this moment.
            launch: the pilot's local frame in the autopilot's.
            now_s: now, by a clock that never goes back.

        Returns whether setpoints have been streamed for long enough to request offboard mode.
        """
        position, velocity = ned_from_enu_position(setpoint.position_m, launch), ned_from_enu(setpoint.velocity_mps)
        acceleration, yaw_rad = ned_from_enu(setpoint.acceleration_mps2), ned_yaw(setpoint.yaw_rad)
        if not isfinite(sum((*position, *velocity, *acceleration, yaw_rad, setpoint.yaw_rate_rps))):
            self._link.counters["setpoints_not_finite"] += 1  # to PX4 a NaN means: do not control this
            return False
        x, y, z = position
        vx, vy, vz = velocity
        afx, afy, afz = acceleration
        fields = {"x": x, "y": y, "z": z, "vx": vx, "vy": vy, "vz": vz, "afx": afx, "afy": afy, "afz": afz, "yaw": yaw_rad}
        fields |= {"yaw_rate": -setpoint.yaw_rate_rps, "coordinate_frame": LOCAL_NED, "type_mask": USE_ALL}
        self._link.send("SET_POSITION_TARGET_LOCAL_NED", fields | {"time_boot_ms": int(now_s * 1e3) % 2**32})
        if now_s - self._last_s > STREAM_GAP_S:
            self._from_s = now_s
        self._last_s = now_s
        return now_s - self._from_s >= STREAM_S
