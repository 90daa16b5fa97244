"""The line of sight from a camera to the source's place in each Gaussian of a track, and gradients of measurements along it.

With p the measured camera position and T the age of the measurement, w = (x - T vx + bx, y - T vy + by, ground height + z) - p,
D = |w|. The ground's height is that below (x - T vx, y - T vy), and its slope (``rise``) enters the gradients. z, the source's
height above the ground, is part of the state over soil, else 0.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from radron.agent.fusion.bayes.motion import BIAS, BIASES, HEADING, HEIGHT
from radron.agent.fusion.bayes.response import MIN_SOURCE_DISTANCE_M, Response
from radron.agent.fusion.bayes.shielding import Shielding
from radron.agent.fusion.bayes.soil import IMAGE_DEPTH
from radron.agent.geometry import Array, Vector3
from radron.agent.terrain.buildings import Buildings
from radron.agent.terrain.ground import Ground

_MIN_ABOVE_M = 0.3  # of a camera above the image of the source


class Scene(Struct, frozen=True, eq=False):
    """Prior knowledge about the measurements: response of the cameras to the nuclide, ground, and known walls and buildings."""

    response: Response
    ground: Ground
    buildings: Buildings | None = None


class LineOfSight(Struct, frozen=True, eq=False):
    """The lines from one vehicle's camera to the source's place at each Gaussian of a track: S sites (places), M motion modes.

    vehicle: index. way: (S, M, 3) vector w from the camera to the source, distance: (S, M) D = |w|, at least
    ``MIN_SOURCE_DISTANCE_M``; rise: (S, M, 2) slope of the ground there, None if level. raised: (S, M) height z of the source
    above the ground, None if not part of the state. age_s: age T of the measurement."""

    vehicle: int
    age_s: float
    way: Array
    distance: Array
    rise: Array | None
    raised: Array | None

    @staticmethod
    def of(mean: Array, scene: Scene, vehicle: int, position: Vector3, age_s: float) -> LineOfSight:
        """Return the lines to the place that the source had at each Gaussian a time age_s ago.

        mean: (S, M, d) means of the Gaussians. position: p of the camera, mission frame.
        """
        b, ground = BIASES + BIAS * vehicle, scene.ground
        place = mean[..., :2] - age_s * mean[..., 2:4]
        way = np.empty((*mean.shape[:2], 3))
        way[..., :2] = place + mean[..., b : b + 2]
        rise = None
        if ground.level:
            way[..., 2] = ground.height_m(0.0, 0.0)
        else:
            places = place.reshape(-1, 2)
            way[..., 2] = ground.heights_m(places).reshape(way.shape[:2])
            rise = ground.slopes(places).reshape(place.shape)
        way -= position
        raised = None if scene.response.over_soil is None else mean[..., HEIGHT]
        if raised is not None:
            way[..., 2] += raised
        return LineOfSight(vehicle, age_s, way, np.maximum(np.sqrt(np.vecdot(way, way)), MIN_SOURCE_DISTANCE_M), rise, raised)

    def image(self) -> Array:
        """Return the vectors (S, M, 3) from the camera to the image of the source in the soil (``soil``), which is always below
        the camera.
        """
        way = self.way.copy()
        if self.raised is not None:
            way[..., 2] -= (1.0 + IMAGE_DEPTH) * self.raised
        way[..., 2] = np.minimum(way[..., 2], -_MIN_ABOVE_M)
        return way

    def spot(self, covariance: Array) -> Array:
        """Return the horizontal variance (S, M) in m2 of the vector from camera to source, sum of both axes; covariance: (S, M,
        d, d).
        """
        b = BIASES + BIAS * self.vehicle
        east, north = (covariance[..., k, k] + 2.0 * covariance[..., k, b + k] + covariance[..., b + k, b + k] for k in (0, 1))
        return np.maximum(east + north, 0.0)

    def gradient(self, slope: Array, dimensions: int) -> Array:
        """Return the gradients h (S, M, ..., d) of measurements by the d state variables of a track (posterior of a found
        source).

        slope: (S, M, ..., 3) derivatives of the measurements by the vector w from camera to source.
        h_xy = slope_xy + slope_z rise (a source further up the hill lies higher), h_vxvy = -T h_xy for the velocity, T the age,
        h_bxby = slope_xy for the vehicle's position error, h_z = slope_z for the source's height. dimensions: d.
        """
        b, flat = BIASES + BIAS * self.vehicle, slope[..., :2]
        gradient = np.zeros((*slope.shape[:-1], dimensions))
        gradient[..., b : b + 2] = flat
        if self.rise is not None:
            flat = flat + slope[..., 2:] * self.rise.reshape(*self.rise.shape[:2], *(1,) * (slope.ndim - 3), 2)
        gradient[..., :2], gradient[..., 2:4] = flat, -self.age_s * flat
        if self.raised is not None:
            gradient[..., HEIGHT] = slope[..., 2]
        return gradient

    def shielding(self, buildings: Buildings, position: Vector3, mean: Array, covariance: Array) -> Shielding:
        """Return the transmission of known walls and buildings along the lines. position, mean: as in ``of``; covariance: (S, M,
        d, d).
        """
        b = BIASES + BIAS * self.vehicle
        start = np.broadcast_to(np.array(position), self.way.shape).copy()
        start[..., :2] -= mean[..., b : b + 2]
        return Shielding.of(buildings, start, self.way, np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1)[..., :2]))

    def turned(self, axes: Array, mean: Array) -> Array:
        """Return the axes (S, M, K, 3) of a cone's K readings, corrected by the vehicle's heading error psi at each Gaussian:
        R_z(-psi) n_k.

        axes: (K, 3) n_k as measured.
        """
        heading = mean[..., BIASES + BIAS * self.vehicle + HEADING]
        cos, sin = np.cos(heading), np.sin(heading)
        turned = np.empty((*heading.shape, *axes.shape))
        turned[..., 0] = cos[..., None] * axes[:, 0] + sin[..., None] * axes[:, 1]
        turned[..., 1] = cos[..., None] * axes[:, 1] - sin[..., None] * axes[:, 0]
        turned[..., 2] = axes[:, 2]
        return turned
