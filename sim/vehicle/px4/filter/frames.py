"""The vehicles' local frames in the world; all position errors of the autopilots are errors of these frames."""

from __future__ import annotations

from math import cos, sin

import numpy as np

from radron.sim.geometry import Array, Vector3
from radron.sim.vehicle.guidance import Reframing
from radron.sim.world.frame import LocalFrames


class AutopilotFrames(LocalFrames):
    """The frames of N autopilots.

    A frame kept by ``follow`` lies at ``offset_m`` from the frame of the vehicle's localisation; one that is corrected by vision
    lies where the corrections have moved it.
    """

    def __init__(self, localized: LocalFrames, offset_m: Array) -> None:
        """``offset_m``: (N, 3), of the origin of ``localized`` in the autopilot's frame."""
        super().__init__([((0.0, 0.0, 0.0), 0.0)] * len(offset_m))
        self._localized, self._offset_m = localized, offset_m
        for drone in range(len(offset_m)):
            self.follow(drone)

    def follow(self, drone: int) -> None:
        """Keep the frame at the vehicle's localisation."""
        localized = self._localized
        yaw = float(localized.yaw_rad[drone])
        self._put(drone, localized.origin[drone] - localized.matrix[drone] @ self._offset_m[drone], yaw)

    def correct(self, drone: int, place: Array, shift_m: Vector3, turn_rad: float) -> Reframing:
        """Move a frame so that the estimate of the vehicle, at ``place`` (3,) in the world, is shifted (in its frame) and turned.
        Returns ``new from old``.
        """
        here = self.matrix[drone].T @ (place - self.origin[drone])
        yaw = float(self.yaw_rad[drone]) - turn_rad
        matrix = _about_up(yaw)
        there = here + np.array(shift_m)
        self._put(drone, place - matrix @ there, yaw)
        x, y, z = (there - _about_up(turn_rad) @ here).tolist()
        return Reframing(turn_rad, (x, y, z))

    def beside(self, drone: int, frame: Reframing) -> Reframing:
        """A jump of the localisation's frame, in the autopilot's own coordinates."""
        offset = self._offset_m[drone]
        x, y, z = (np.array(frame.translation_m) + offset - _about_up(frame.yaw_rad) @ offset).tolist()
        return Reframing(frame.yaw_rad, (x, y, z))

    def move(self, drone: int, moved_m: Array) -> Reframing:
        """Move the origin of a frame by ``moved_m`` (3,) in the world. Returns ``new from old``."""
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
