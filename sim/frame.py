"""The simulation's own geometry: a vehicle's local frame in the world, and where its camera looks."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians, sin, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sim.radiation.camera import SourceView

Array = NDArray[np.float64]
Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """World from local: yaw about up, then translation. Both ENU, metres."""

    origin: Array
    yaw_rad: float
    matrix: Array

    @staticmethod
    def of(origin_m: Vector3, yaw_deg: float) -> LocalFrame:
        """The frame with this origin and heading in the world."""
        yaw = radians(yaw_deg)
        matrix = np.array([[cos(yaw), -sin(yaw), 0.0], [sin(yaw), cos(yaw), 0.0], [0.0, 0.0, 1.0]])
        return LocalFrame(np.array(origin_m, dtype=np.float64), yaw, matrix)

    def local(self, world: Array) -> Vector3:
        """A world position in this frame."""
        return self.turn(world - self.origin)

    def turn(self, vector: Array) -> Vector3:
        """A world vector in this frame."""
        x, y, z = (vector @ self.matrix).tolist()
        return x, y, z

    def world(self, local: Vector3) -> Array:
        """A position of this frame in the world."""
        result: Array = self.matrix @ local + self.origin
        return result


class CameraMount:
    """How a camera sits on its vehicle, and what it sees from there."""

    def __init__(self, rpy_deg: Vector3) -> None:
        self._camera_from_body: Array = Rotation.from_euler("xyz", rpy_deg, degrees=True).as_matrix().T

    def view(self, position: Array, world_from_body: Quaternion, source: tuple[float, float], activity_bq: float) -> SourceView:
        """The source on the ground as the camera sees it; position (3,) of the camera in the world."""
        x, y, z = position.tolist()
        dx, dy, dz = source[0] - x, source[1] - y, -z
        distance = sqrt(dx * dx + dy * dy + dz * dz)
        body = _turn_back(world_from_body, (dx / distance, dy / distance, dz / distance))
        cx, cy, cz = (self._camera_from_body @ body).tolist()
        return SourceView(direction=(cx, cy, cz), distance_m=distance, activity_bq=activity_bq)


def _turn_back(quaternion: Quaternion, vector: Vector3) -> Vector3:
    """Rotate a vector by the inverse of a unit quaternion (w, x, y, z)."""
    w, x, y, z = quaternion
    a, b, c = vector
    # v + 2 q x (q x v - w v), with q the vector part
    tx, ty, tz = y * c - z * b - w * a, z * a - x * c - w * b, x * b - y * a - w * c
    return a + 2.0 * (y * tz - z * ty), b + 2.0 * (z * tx - x * tz), c + 2.0 * (x * ty - y * tx)
