"""Local frames of the emulated vehicles in the world; the autopilots' position errors are errors of these frames."""

from __future__ import annotations

from math import cos, sin

import numpy as np

from radron.sim.geometry import Array, Vector3
from radron.sim.vehicle.guidance import Reframing
from radron.sim.world.frame import LocalFrames


class AutopilotFrames(LocalFrames):
    """The local frames of N emulated autopilots in the world.

    A frame that follows the vehicle's localisation (``follow``) lies at ``offset_m`` from the frame of the localisation; a frame
    that is corrected by vision lies where the corrections have moved it.
    """

    def __init__(self, localized: LocalFrames, offset_m: Array) -> None:
        """``localized``: frames of the vehicles' localisation. ``offset_m``: (N, 3) origins of these frames in the autopilots'
        frames.
        """
        super().__init__([((0.0, 0.0, 0.0), 0.0)] * len(offset_m))
        self._localized, self._offset_m = localized, offset_m
        for drone in range(len(offset_m)):
            self.follow(drone)

    def follow(self, drone: int) -> None:
        """Let the local frame of a vehicle follow its localisation."""
        localized = self._localized
        yaw = float(localized.yaw_rad[drone])
        self._put(drone, localized.origin[drone] - localized.matrix[drone] @ self._offset_m[drone], yaw)

    def correct(self, drone: int, place: Array, shift_m: Vector3, turn_rad: float) -> Reframing:
        """Move a local frame so that the vehicle's estimate is shifted and turned.

        ``place``: (3,) estimated position in the world. ``shift_m``: in the vehicle's frame. Return the transform from the old to
        the new frame.
        """
        here = self.matrix[drone].T @ (place - self.origin[drone])
        yaw = float(self.yaw_rad[drone]) - turn_rad
        matrix = _about_up(yaw)
        there = here + np.array(shift_m)
        self._put(drone, place - matrix @ there, yaw)
        x, y, z = (there - _about_up(turn_rad) @ here).tolist()
        return Reframing(turn_rad, (x, y, z))

    def beside(self, drone: int, frame: Reframing) -> Reframing:
        """Convert a jump of the localisation's frame to the autopilot's own coordinates."""
        offset = self._offset_m[drone]
        x, y, z = (np.array(frame.translation_m) + offset - _about_up(frame.yaw_rad) @ offset).tolist()
        return Reframing(frame.yaw_rad, (x, y, z))

    def move(self, drone: int, moved_m: Array) -> Reframing:
        """Move the origin of a local frame by ``moved_m`` (3,) in the world.

        Return the transform from the old to the new frame.
        """
        local = self.matrix[drone].T @ moved_m
        self._offset_m[drone] -= local
        self._put(drone, self.origin[drone] + moved_m, float(self.yaw_rad[drone]))
        x, y, z = (-local).tolist()
        return Reframing(0.0, (x, y, z))

    def _put(self, drone: int, origin: Array, yaw: float) -> None:
        self.origin[drone], self.yaw_rad[drone] = origin, yaw
        self.matrix[drone] = _about_up(yaw)
        self._transposed[drone] = self.matrix[drone].T


def _about_up(yaw: float) -> Array:
    return np.array([[cos(yaw), -sin(yaw), 0.0], [sin(yaw), cos(yaw), 0.0], [0.0, 0.0, 1.0]])
