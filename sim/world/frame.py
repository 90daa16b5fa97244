"""Frame geometry of the simulation: the vehicles' local frames in the world, and the poses of their cameras."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin, sqrt

import numpy as np
from scipy.spatial.transform import Rotation

from radron.sim.geometry import Array, Quaternion, Vector3
from radron.sim.radiation.camera import SourceView

_DOWN: Vector3 = (0.0, 0.0, -1.0)


class LocalFrames:
    """The local frames of N vehicles, in which their localisation gives positions.

    The transform from local to world is a rotation by yaw about the vertical axis, then a translation. All ENU, metres. origin:
    (N, 3); yaw_rad: (N,); matrix: (N, 3, 3) rotates local vectors into the world.
    """

    def __init__(self, frames: Sequence[tuple[Vector3, float]]) -> None:
        """``frames``: for each vehicle, the origin in the world and the heading in degrees."""
        self.origin: Array = np.array([origin for origin, _ in frames], dtype=np.float64)
        self.yaw_rad: Array = np.radians([yaw_deg for _, yaw_deg in frames])
        self.matrix: Array = np.array([_about_up(yaw) for yaw in self.yaw_rad.tolist()])
        self._transposed: Array = np.ascontiguousarray(self.matrix.transpose(0, 2, 1))

    def local(self, world: Array) -> list[Vector3]:
        """Convert the positions (N, 3) of the vehicles from the world to their own local frames."""
        return self.turn(world - self.origin)

    def turn(self, vectors: Array) -> list[Vector3]:
        """Rotate vectors (N, 3) from the world to the vehicles' own local frames."""
        turned: list[Vector3] = list(map(tuple, np.vecmat(vectors, self.matrix).tolist()))
        return turned

    def to_world(self, vectors: Sequence[Sequence[Vector3]]) -> Array:
        """Rotate M vectors of each vehicle from its local frame to the world; the result is (N, M, 3)."""
        result: Array = np.array(vectors) @ self._transposed
        return result


def _about_up(yaw: float) -> list[list[float]]:
    return [[cos(yaw), -sin(yaw), 0.0], [sin(yaw), cos(yaw), 0.0], [0.0, 0.0, 1.0]]


class CameraMount:
    """How a camera is mounted on its vehicle, to find the direction of a source in the camera frame."""

    def __init__(self, rpy_deg: Vector3) -> None:
        self._camera_from_body: list[Vector3] = Rotation.from_euler("xyz", rpy_deg, degrees=True).as_matrix().T.tolist()

    def camera_from_world(self, world_from_body: Quaternion) -> Array:
        """Return the rotation (3, 3) from the world to the camera frame. ``world_from_body``: attitude of the vehicle."""
        axes = [_turn_back(world_from_body, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
        return np.asarray(np.array(self._camera_from_body) @ np.array(axes).T)

    def view(self, position: Array, world_from_body: Quaternion, source: Vector3, activity_bq: float) -> SourceView:
        """Return the source as the camera sees it, from the true positions of camera (3,) and source in the world.

        ``world_from_body``: attitude of the vehicle. A source at the camera's own position is seen from below.
        """
        x, y, z = position.tolist()
        dx, dy, dz = source[0] - x, source[1] - y, source[2] - z
        distance = sqrt(dx * dx + dy * dy + dz * dz)
        to_source = (dx / distance, dy / distance, dz / distance) if distance > 0.0 else _DOWN
        u, v, w = _turn_back(world_from_body, to_source)
        cx, cy, cz = (a * u + b * v + c * w for a, b, c in self._camera_from_body)
        return SourceView(direction=(cx, cy, cz), distance_m=distance, activity_bq=activity_bq)


def _turn_back(quaternion: Quaternion, vector: Vector3) -> Vector3:
    """Rotate a vector by the inverse of a unit quaternion (w, x, y, z)."""
    w, x, y, z = quaternion
    a, b, c = vector
    # v + 2 q x (q x v - w v), with q the vector part
    tx, ty, tz = y * c - z * b - w * a, z * a - x * c - w * b, x * b - y * a - w * c
    return a + 2.0 * (y * tz - z * ty), b + 2.0 * (z * tx - x * tz), c + 2.0 * (x * ty - y * tx)
