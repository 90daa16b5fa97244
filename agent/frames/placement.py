"""The estimated pose of a drone's continuous frame at one keyframe."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from agent.frames.transform import Transform
from agent.geometry import Array


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """pose: (4,) of the drone in the mission frame (its position, its frame's heading). covariance: (4, 4). at: (3,) the same
    position in the continuous frame.
    """

    pose: Array
    covariance: Array
    at: Array

    def transform(self, continuous_from_local: Transform) -> Transform:
        """``mission_from_local`` of a segment, with its covariance about the segment's own origin."""
        pose, covariance = self.carried(np.array(continuous_from_local.translation))
        east, north, up, yaw = pose.tolist()
        heading = float(np.remainder(yaw + continuous_from_local.yaw_rad + np.pi, 2.0 * np.pi) - np.pi)
        return Transform(heading, (east, north, up), covariance)

    def carried(self, at: Array) -> tuple[Array, Array]:
        """Pose and covariance of a drone that has moved to ``at`` (3,), under this placement."""
        yaw = self.pose[3]
        c, s = np.cos(yaw), np.sin(yaw)
        x, y, z = at - self.at
        arm = np.array([c * x - s * y, s * x + c * y, z])
        jacobian = np.eye(4)
        jacobian[:3, 3] = -arm[1], arm[0], 0.0
        return np.append(self.pose[:3] + arm, yaw), jacobian @ self.covariance @ jacobian.T
