"""The tracker's vertical part: within the limits, between floor and ceiling."""

from __future__ import annotations

import numpy as np

from agent.config import LimitsConfig
from agent.motion.braking import brake
from agent.motion.fence import Fence
from agent.motion.prediction import Prediction
from agent.motion.qp import HalfPlanes, LimitedProblem
from agent.motion.reference import Array
from agent.motion.steering import Peaks, Status

_ACCELERATION_SHARE = 0.5  # of the limit; the rest is for the turns


class Climbing:
    """Vertical jerks for each replan."""

    def __init__(self, limits: LimitsConfig, fence: Fence, prediction: Prediction, step_s: float, horizon: int) -> None:
        self._limits = (limits.climb_mps, _ACCELERATION_SHARE * limits.acceleration_mps2, limits.jerk_mps3)
        self._low, self._high = fence.floor_m, fence.ceiling_m
        self._step_s, self._horizon = step_s, horizon
        self._problem = LimitedProblem(prediction, step_s, 1, self._limits, 2)
        normals = np.repeat(np.array([1.0, -1.0]), horizon).reshape(2, horizon, 1)
        offsets = np.repeat(np.array([fence.floor_m, -fence.ceiling_m]), horizon).reshape(2, horizon)
        self._planes = HalfPlanes(normals, offsets, np.ones((2, horizon)))

    def jerk(self, start: Array, optimum: Array, peaks: Peaks, guess: Array) -> tuple[Status, Array]:
        """Jerks (H,) from the unconstrained optimum (4, H, 1) and its peaks. start: (3, 1); guess: (H, 1), to begin with."""
        if self._within_limits(float(start[0, 0]), optimum, peaks):
            return Status.FREE, optimum[0, :, 0]
        found = self._problem.solve(start, optimum, self._planes, guess)
        if found is not None:
            return Status.CONSTRAINED, found[:, 0]
        velocity, acceleration = start[1:, 0].tolist()
        stop = brake((velocity, 0.0), (acceleration, 0.0), (0.0, 0.0), self._limits[1:], self._step_s, self._horizon)
        return Status.BRAKING, stop[:, 0]

    def _within_limits(self, z: float, optimum: Array, peaks: Peaks) -> bool:
        (_, _, jerk), (_, _, way), (_, _, velocity), (_, _, acceleration) = peaks
        if velocity > self._limits[0] or acceleration > self._limits[1] or jerk > self._limits[2]:
            return False
        if self._low <= z - way and z + way <= self._high:
            return True
        return float(optimum[1].min()) >= self._low and float(optimum[1].max()) <= self._high
