"""Where each vehicle's own local frame lies in the world, at this moment: that is all that is wrong with its position."""

from __future__ import annotations

from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from sim.frame import LocalFrames, Vector3
from sim.vehicle.guidance import Reframing

Array = NDArray[np.float64]


class AutopilotFrames(LocalFrames):
    """The frames of N autopilots.

    A frame that ``follow`` keeps lies ``offset_m`` beside where the vehicle's localisation has its frame; one that is
    corrected by vision lies where that has led it.
    """

    def __init__(self, localized: LocalFrames, offset_m: Array) -> None:
        """``offset_m``: (N, 3), of the place of ``localized``'s origin in the autopilot's frame."""
        super().__init__([((0.0, 0.0, 0.0), 0.0)] * len(offset_m))
        self._localized, self._offset_m = localized, offset_m
        for drone in range(len(offset_m)):
            self.follow(drone)

    def follow(self, drone: int) -> None:
        """Lie where the vehicle's localisation has it."""
        localized = self._localized
        yaw = float(localized.yaw_rad[drone])
        self._put(drone, localized.origin[drone] - localized.matrix[drone] @ self._offset_m[drone], yaw)

    def correct(self, drone: int, place: Array, shift_m: Vector3, turn_rad: float) -> Reframing:
        """Move a frame so that the vehicle, at ``place`` (3,) in the world, finds itself shifted (in its frame) and turned by so
        much. Returns ``new from old``.
        """
        here = self.matrix[drone].T @ (place - self.origin[drone])
        yaw = float(self.yaw_rad[drone]) - turn_rad
        matrix = _about_up(yaw)
        there = here + np.array(shift_m)
        self._put(drone, place - matrix @ there, yaw)
        x, y, z = (there - _about_up(turn_rad) @ here).tolist()
        return Reframing(turn_rad, (x, y, z))

    def beside(self, drone: int, frame: Reframing) -> Reframing:
        """A jump of where the localisation has the frame, in the autopilot's own coordinates."""
        offset = self._offset_m[drone]
        x, y, z = (np.array(frame.translation_m) + offset - _about_up(frame.yaw_rad) @ offset).tolist()
        return Reframing(frame.yaw_rad, (x, y, z))

    def _put(self, drone: int, origin: Array, yaw: float) -> None:
        self.origin[drone], self.yaw_rad[drone] = origin, yaw
        self.matrix[drone] = _about_up(yaw)
        self._transposed[drone] = self.matrix[drone].T


def _about_up(yaw: float) -> Array:
    return np.array([[cos(yaw), -sin(yaw), 0.0], [sin(yaw), cos(yaw), 0.0], [0.0, 0.0, 1.0]])
