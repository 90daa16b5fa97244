"""The SLAM on board of each vehicle that has one: its poses, in its own frame, as an agent gets them."""

from __future__ import annotations

import numpy as np

from sim.localization import Localization
from sim.movingframes import MovingFrames
from sim.vehicle.multirotor import GRAVITY_MPS2, Multirotors, attitude

_EACH_ANGLE_RAD = 0.02  # 1 sigma that it tells of roll, pitch and yaw


class Slam:
    """What N vehicles' SLAMs see, of those that have one."""

    def __init__(self, motion: Multirotors, error: Localization, frames: MovingFrames) -> None:
        self._motion, self._error, self._frames = motion, error, frames

    def pose(self, drone: int, stamp_ns: int) -> dict[str, object]:
        """One vehicle's pose now."""
        motion, error, frames = self._motion, self._error, self._frames
        inward = frames.matrix[drone].T
        position = inward @ (motion.position_m[drone] + error.position_error_m[drone] - frames.origin[drone])
        acceleration = inward @ (motion.acceleration_mps2[drone] + GRAVITY_MPS2 * error.tilt_error[drone])
        yaw = float(motion.yaw_rad[drone] + error.yaw_error_rad[drone] - frames.yaw_rad[drone])
        variance = 0.5 * frames.told_m[drone] ** 2  # of each horizontal axis
        return {
            "stamp_ns": stamp_ns,
            "position_m": position.tolist(),
            "quaternion": attitude(yaw, *acceleration.tolist()),
            "covariance": np.diag([variance] * 3 + [_EACH_ANGLE_RAD**2] * 3).ravel().tolist(),
            "reset_counter": frames.epoch[drone] % 256,
        }
