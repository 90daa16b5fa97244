"""Simulated SLAM on board of some vehicles: poses in the SLAM's own frame, as an agent receives them."""

from __future__ import annotations

import numpy as np

from radron.sim.vehicle.multirotor import GRAVITY_MPS2, Multirotors, attitude
from radron.sim.world.localization import Localization
from radron.sim.world.movingframes import MovingFrames

_EACH_ANGLE_RAD = 0.02  # 1 sigma reported for roll, pitch and yaw


class Slam:
    """Makes the SLAM poses of vehicles that localise by SLAM, from their true motion and their errors."""

    def __init__(self, motion: Multirotors, error: Localization, frames: MovingFrames) -> None:
        self._motion, self._error, self._frames = motion, error, frames

    def pose(self, drone: int, stamp_ns: int) -> dict[str, object]:
        """Return one vehicle's present SLAM pose, as a message to its agent."""
        motion, error, frames = self._motion, self._error, self._frames
        inward = frames.matrix[drone].T
        position = inward @ (motion.position_m[drone] + error.position_error_m[drone] - frames.origin[drone])
        thrust = inward @ (motion.thrust_mps2[drone] + GRAVITY_MPS2 * error.tilt_error[drone])
        yaw = float(motion.yaw_rad[drone] + error.yaw_error_rad[drone] - frames.yaw_rad[drone])
        variance = 0.5 * frames.told_m[drone] ** 2  # of each horizontal axis
        return {
            "stamp_ns": stamp_ns,
            "position_m": position.tolist(),
            "quaternion": attitude(yaw, *thrust.tolist()),
            "covariance": np.diag([variance] * 3 + [_EACH_ANGLE_RAD**2] * 3).ravel().tolist(),
            "reset_counter": frames.epoch[drone] % 256,
        }
