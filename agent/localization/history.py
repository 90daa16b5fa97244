"""Telemetry of the last seconds, for the position and attitude of the vehicle at the time of an event."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from math import remainder, tau
from typing import NamedTuple

from radron.agent.geometry import Quaternion, Vector3, blended, yaw_of
from radron.agent.vehicle.interface import VehicleState

HISTORY_NS = 5_000_000_000
SLOPE_NS, SHORTEST_NS = 500_000_000, 10_000_000  # telemetry further apart in time, or nearer together, gives no turn rate
AHEAD_NS = 300_000_000  # an event may be this much later than the newest telemetry: newer telemetry is still on its way
GAP_NS = 1_000_000_000  # in a longer gap of the telemetry the position is not known


class PastPose(NamedTuple):
    """Position (m) and attitude (local from body) in the local frame of ``epoch``."""

    epoch: int
    position_m: Vector3
    quaternion: Quaternion


class PoseHistory:
    """Telemetry of the last 5 s, interpolated at the time of an event. (The newest pose instead would bias the heading of a
    turning vehicle.)

    Only ``radron.agent.localization.ownpose`` adds to it.
    """

    def __init__(self) -> None:
        self._stamps: deque[int] = deque()
        self._states: deque[VehicleState] = deque()
        self._since_ns = 0  # the first telemetry after the last gap

    def add(self, state: VehicleState) -> None:
        """Append telemetry; ignore it if it is not newer than the newest."""
        if self._stamps and state.stamp_ns <= self._stamps[-1]:
            return
        if not self._stamps or state.stamp_ns - self._stamps[-1] > GAP_NS:
            self._since_ns = state.stamp_ns
        self._stamps.append(state.stamp_ns)
        self._states.append(state)
        while self._stamps[0] < state.stamp_ns - HISTORY_NS:
            self._stamps.popleft()
            self._states.popleft()

    @property
    def newest(self) -> VehicleState | None:
        """The newest telemetry; None before the first."""
        return self._states[-1] if self._states else None

    @property
    def turning_rps(self) -> float | None:
        """Turn rate (rad/s) by the last two telemetry messages; None if they are of two epochs, or too near or too far apart in
        time.
        """
        if len(self._states) < 2:
            return None
        before, last = self._states[-2], self._states[-1]
        elapsed_ns = last.stamp_ns - before.stamp_ns
        if before.epoch != last.epoch or not SHORTEST_NS <= elapsed_ns <= SLOPE_NS:
            return None
        return remainder(yaw_of(last.quaternion) - yaw_of(before.quaternion), tau) / (elapsed_ns * 1e-9)

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Stamps of the oldest and the newest telemetry with no gap between them; None without telemetry."""
        return (max(self._stamps[0], self._since_ns), self._stamps[-1]) if self._stamps else None

    def keeps(self, stamp_ns: int) -> bool:
        """Whether a stamp lies between the oldest and the newest telemetry kept."""
        return bool(self._stamps) and self._stamps[0] <= stamp_ns <= self._stamps[-1]

    def at(self, stamp_ns: int) -> VehicleState | None:
        """Return the last telemetry up to ``stamp_ns``, or the oldest one if all is later; None without telemetry."""
        if not self._states:
            return None
        return self._states[max(0, bisect_right(self._stamps, stamp_ns) - 1)]

    def pose(self, stamp_ns: int) -> tuple[Vector3, Quaternion] | None:
        """Return position and attitude at ``stamp_ns``, local frame, interpolated between two telemetry messages; None without
        telemetry.

        Between messages of two epochs, and before and after all telemetry, the nearest earlier pose (else the oldest) is
        returned.
        """
        if not self._states:
            return None
        place = bisect_right(self._stamps, stamp_ns)
        before = self._states[place - 1 if place else 0]
        after = self._states[place] if place < len(self._states) else before
        span = after.stamp_ns - before.stamp_ns
        if span <= 0 or before.epoch != after.epoch:
            return before.position_m, before.quaternion
        part = (stamp_ns - before.stamp_ns) / span
        b, a = before.position_m, after.position_m
        position = (b[0] + part * (a[0] - b[0]), b[1] + part * (a[1] - b[1]), b[2] + part * (a[2] - b[2]))
        return position, blended(before.quaternion, after.quaternion, part)

    def extrapolated(self, stamp_ns: int) -> PastPose | None:
        """Return the pose at ``stamp_ns``. Up to 0.3 s after the newest telemetry it is extrapolated at constant velocity; None
        later than that, and before the last gap in the telemetry.
        """
        span_ns = self.span_ns
        if span_ns is None or not span_ns[0] <= stamp_ns <= span_ns[1] + AHEAD_NS:
            return None
        pose, state = self.pose(stamp_ns), self.at(stamp_ns)
        assert pose is not None
        assert state is not None
        (x, y, z), quaternion = pose
        after_s = max(0, stamp_ns - self._stamps[-1]) * 1e-9
        u, v, w = state.velocity_mps
        return PastPose(state.epoch, (x + after_s * u, y + after_s * v, z + after_s * w), quaternion)
