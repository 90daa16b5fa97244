"""The estimated pose of a drone's continuous frame at one keyframe."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radron.agent.frames.transform import Transform
from radron.agent.geometry import Array


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """The estimated pose of a drone at one keyframe (time of an estimate), which places its continuous track in the mission
    frame.

    pose: (4,) x, y, z of the drone in the mission frame, and heading of its continuous frame. covariance: (4, 4). at: (3,)
    position of the drone in its continuous frame.
    """

    pose: Array
    covariance: Array
    at: Array

    def transform(self, continuous_from_local: Transform) -> Transform:
        """Return the transform from the local frame of a segment (part of the track between two jumps) into the mission frame.

        The covariance is about the segment's own origin. continuous_from_local: transform of the segment into the continuous
        frame.
        """
        pose, covariance = self.carried(np.array(continuous_from_local.translation))
        east, north, up, yaw = pose.tolist()
        heading = float(np.remainder(yaw + continuous_from_local.yaw_rad + np.pi, 2.0 * np.pi) - np.pi)
        return Transform(heading, (east, north, up), covariance)

    def carried(self, at: Array) -> tuple[Array, Array]:
        """Return pose (4,) and covariance (4, 4) of the drone after it has moved to ``at`` (3,) in its continuous frame."""
        yaw = self.pose[3]
        c, s = np.cos(yaw), np.sin(yaw)
        x, y, z = at - self.at
        arm = np.array([c * x - s * y, s * x + c * y, z])
        jacobian = np.eye(4)
        jacobian[:3, 3] = -arm[1], arm[0], 0.0
        return np.append(self.pose[:3] + arm, yaw), jacobian @ self.covariance @ jacobian.T
