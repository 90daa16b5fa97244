"""Fusion of an external vision's poses (MAVLink's ODOMETRY) in the vehicle's filter, and its behaviour without them.

As in PX4's EKF2: poses are compared with the vehicle's estimate at their time. Poses within the innovation gate correct it
gently, others are rejected. After a second of rejections, or at a reported jump of the vision's own frame, the filter is
reset to it. Without poses it continues by its inertial sensors, which drift, for EKF2_NOAID_TOUT; after that the position is
unknown.
"""

from __future__ import annotations

from collections import deque
from math import atan2, cos, dist, remainder, sin, tau
from typing import NamedTuple

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from radron.sim.geometry import Vector3
from radron.sim.vehicle.px4.parameters import Parameters
from radron.sim.vehicle.px4.state import Message

POSE_GAIN = 0.2  # of one pose
GATE_M, GATE_RAD = 1.0, 0.5
FAILING_S = 1.0  # no_aid_timeout_max
BLIND_AFTER_S = 0.3  # without a pose, until errors of the inertial sensors show
INERTIAL_MPS2 = 0.2  # accelerometer bias and a tilt error of a degree
POSE_MEMORY_S = 0.5  # of its own past
_POSITION = 1  # bit of EKF2_EV_CTRL
_FRAMES = (mavlink.MAV_FRAME_LOCAL_FRD, mavlink.MAV_FRAME_LOCAL_NED)


class Pose(NamedTuple):
    """A pose of the vehicle, ENU, local; ``time_s`` by its own clock. ``resets``: number of jumps of the vision's frame."""

    time_s: float
    position_m: Vector3
    yaw_rad: float
    resets: int = 0


class Correction(NamedTuple):
    """A correction of the vehicle's estimate, in its own frame. ``reset``: it is applied at once, and reported."""

    shift_m: Vector3
    turn_rad: float
    reset: bool = False


class Vision:
    """Emulates how one vehicle's filter uses the poses of an external vision system."""

    def __init__(self, parameters: Parameters, rng: np.random.Generator) -> None:
        self._parameters = parameters
        self._waiting: list[Pose] = []
        self._past: deque[Pose] = deque()
        self._resets: int | None = None  # of the vision, at the latest pose
        self._taken_s = self._reset_s = float("-inf")
        self._left_out_s: float | None = None  # begin of the present rejections
        angle = rng.uniform(0.0, tau)
        self._drift = (cos(angle), sin(angle))

    @property
    def wanted(self) -> bool:
        """Whether the parameters enable the use of vision."""
        return bool(int(self._parameters["EKF2_EV_CTRL"]) & _POSITION)

    def knows_position(self, time_s: float) -> bool:
        """Return whether poses are used, or were until so recently that the inertial sensors suffice."""
        return time_s - self._taken_s < self._parameters["EKF2_NOAID_TOUT"] * 1e-6

    def hear(self, message: Message, time_s: float) -> None:
        """Process an ODOMETRY message (a pose) valid at ``time_s``; frames and quaternions that PX4 refuses are ignored."""
        w, x, y, z = message.q
        finite = np.isfinite([message.x, message.y, message.z, w, x, y, z]).all()
        if message.frame_id not in _FRAMES or not finite:
            return
        yaw = atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        self._waiting.append(Pose(time_s, (message.y, message.x, -message.z), 0.25 * tau - yaw, message.reset_counter))

    def step(self, now: Pose, step_s: float) -> list[Correction]:
        """Compare the poses since the last step with the vehicle's own estimate ``now``, and return the resulting corrections."""
        self._past.append(now)
        while self._past[0].time_s < now.time_s - POSE_MEMORY_S:
            self._past.popleft()
        waiting, self._waiting = self._waiting, []
        corrections = [found for pose in waiting if (found := self._compared(pose, now)) is not None]
        blind_s = now.time_s - self._taken_s
        if not corrections and BLIND_AFTER_S < blind_s < float("inf"):
            way_m = INERTIAL_MPS2 * (blind_s - BLIND_AFTER_S) * step_s
            corrections.append(Correction((way_m * self._drift[0], way_m * self._drift[1], 0.0), 0.0))
        return corrections

    def _compared(self, pose: Pose, now: Pose) -> Correction | None:
        if pose.time_s <= self._reset_s or not self._past:
            return None  # from before the reset, like the estimate that it would be compared with
        then = min(self._past, key=lambda own: abs(own.time_s - pose.time_s))
        x, y, z = (there - here for there, here in zip(pose.position_m, then.position_m, strict=True))
        turn = remainder(pose.yaw_rad - then.yaw_rad, tau)
        jumped = self._resets is not None and pose.resets != self._resets
        lost = not self.knows_position(now.time_s)
        self._resets = pose.resets
        fits = dist((x, y, z), (0.0, 0.0, 0.0)) < GATE_M and abs(turn) < GATE_RAD
        if fits and not (jumped or lost):
            self._taken_s, self._left_out_s = now.time_s, None
            return Correction((POSE_GAIN * x, POSE_GAIN * y, POSE_GAIN * z), POSE_GAIN * turn)
        if not (jumped or lost) and not self._has_failed(now.time_s):
            return None
        self._taken_s, self._reset_s, self._left_out_s = now.time_s, now.time_s, None
        self._past.clear()
        return Correction((x, y, z), turn, reset=True)

    def _has_failed(self, time_s: float) -> bool:
        """Return whether poses have been rejected for long enough to reset the filter to the vision."""
        if self._left_out_s is None:
            self._left_out_s = time_s
        return time_s - self._left_out_s >= FAILING_S
