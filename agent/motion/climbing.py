"""Vertical part of the tracker: it plans the height within the limits, between floor and ceiling of the fence."""

from __future__ import annotations

import numpy as np

from radron.agent.config.mission import LimitsConfig
from radron.agent.geometry import Array
from radron.agent.motion.braking import brake
from radron.agent.motion.fence import Fence
from radron.agent.motion.prediction import Prediction
from radron.agent.motion.qp import HalfPlanes, LimitedProblem
from radron.agent.motion.steering import Peaks, Status

_UNEVEN_M = 0.5  # extra margin to floor and ceiling over uneven ground, whose height ahead is known from a model only
_ACCELERATION_SHARE = 0.5  # share of the acceleration limit; the rest is for turns


class Climbing:
    """Vertical part of each new plan: within the limits, and between floor and ceiling of the fence."""

    def __init__(self, limits: LimitsConfig, fence: Fence, prediction: Prediction, step_s: float, horizon: int) -> None:
        self._limits = (limits.climb_mps, _ACCELERATION_SHARE * limits.acceleration_mps2, limits.jerk_mps3)
        self._step_s, self._horizon = step_s, horizon
        self._problem = LimitedProblem(prediction, step_s, 1, self._limits, 2)
        self.confine(fence)

    def confine(self, fence: Fence) -> None:
        """Replace floor and ceiling by those of another fence."""
        self._low, self._high, horizon = fence.floor_m, fence.ceiling_m, self._horizon
        normals = np.repeat(np.array([1.0, -1.0]), horizon).reshape(2, horizon, 1)
        offsets = np.repeat(np.array([fence.floor_m, -fence.ceiling_m]), horizon).reshape(2, horizon)
        self._planes = HalfPlanes(normals, offsets, np.ones((2, horizon)))

    def jerk(self, start: Array, optimum: Array, peaks: Peaks, guess: Array, ground: Array | None = None) -> tuple[Status, Array]:
        """Return the vertical jerks (H,) of a new plan of H steps, and how they were found.

        Args:
            start: (3, 1), height, vertical velocity and acceleration at the start.
            optimum: (4, H, 1), jerks, heights, velocities, accelerations of the unconstrained optimum.
            peaks: its largest values.
            guess: (H, 1), initial jerks for the solver.
            ground: (H,), height of the ground below the plan at its steps, to which floor and ceiling are then relative; None:
                level ground.
        """
        if self._within_limits(float(start[0, 0]), optimum, peaks, ground):
            return Status.FREE, optimum[0, :, 0]
        found = self._problem.solve(start, optimum, self._over(ground), guess)
        if found is not None:
            return Status.CONSTRAINED, found[:, 0]
        velocity, acceleration = start[1:, 0].tolist()
        stop = brake((velocity, 0.0), (acceleration, 0.0), (0.0, 0.0), self._limits[1:], self._step_s, self._horizon)
        return Status.BRAKING, stop[:, 0]

    def _over(self, ground: Array | None) -> HalfPlanes:
        if ground is None:
            return self._planes
        between = np.stack((ground + _UNEVEN_M, _UNEVEN_M - ground))
        return HalfPlanes(self._planes.normals, self._planes.offsets + between, self._planes.yielding)

    def _within_limits(self, z: float, optimum: Array, peaks: Peaks, ground: Array | None) -> bool:
        (_, _, jerk), (_, _, way), (_, _, velocity), (_, _, acceleration) = peaks
        if velocity > self._limits[0] or acceleration > self._limits[1] or jerk > self._limits[2]:
            return False
        if ground is None and self._low <= z - way and z + way <= self._high:
            return True
        heights, margin = (optimum[1, :, 0], 0.0) if ground is None else (optimum[1, :, 0] - ground, _UNEVEN_M)
        return float(heights.min()) >= self._low + margin and float(heights.max()) <= self._high - margin
