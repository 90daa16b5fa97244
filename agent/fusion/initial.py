"""The initial hypothesis x0 from M cones: non-linear least squares (paper, Sec. V-A; reference, "The paper's filter")."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from shapely import Point, Polygon, contains_xy

from agent.fusion.observation import ConeSurface
from agent.ground import LEVEL, Ground

GRID_PITCH_M = 2.0
_TINY_M = 1e-9  # keeps the gradient finite on a cone's axis

Array = NDArray[np.float64]


class InitialSearch:
    """Finds the point on the ground of the searched area with the least squared distance to the cones.

    Residual of a cone, with v = p - apex and alpha = angle(v, axis): |v| sin(alpha - theta). It is started from the best point of
    a grid over the area, because the sum of squares has local minima (at the apexes, to begin with), and kept inside the
    area's bounding box, because cones that hardly cross leave the distance along them open. The result is never worse than the
    best grid point.
    """

    def __init__(self, area: Polygon, ground: Ground = LEVEL) -> None:
        self.ground = ground
        self.bounds: tuple[float, float, float, float] = area.bounds  # west, south, east, north
        west, south, east, north = self.bounds
        self._lower, self._upper = np.array([west, south]), np.array([east, north])
        columns = np.arange(west + GRID_PITCH_M / 2, east, GRID_PITCH_M)
        rows = np.arange(south + GRID_PITCH_M / 2, north, GRID_PITCH_M)
        points = np.stack([axis.ravel() for axis in np.meshgrid(columns, rows)], axis=-1)
        inside: Array = points[contains_xy(area, points)]
        if not len(inside):  # an area thinner than the grid
            middle: Point = area.representative_point()
            inside = np.array([[middle.x, middle.y]])
        self._grid = inside

    def solve(self, cones: Sequence[ConeSurface]) -> tuple[float, float]:
        """(x, y) of x0 from the cones, metres, mission frame. The same cones give the same bits."""
        apex = np.array([cone.apex for cone in cones])
        axis = np.array([cone.axis for cone in cones])
        theta = np.array([cone.theta_rad for cone in cones])
        cos, sin = np.cos(theta), np.sin(theta)

        def distances(ground: Array) -> tuple[Array, Array, Array, Array]:
            """Of points (..., 2): v (..., M, 3), |v| cos alpha, |v| sin alpha and the residual, (..., M) each."""
            heights = self.ground.heights_m(ground.reshape(-1, 2)).reshape(*ground.shape[:-1], 1)
            v = np.concatenate([ground, heights], axis=-1)[..., None, :] - apex
            along = np.sum(v * axis, axis=-1)
            across = np.sqrt(np.maximum(np.sum(v * v, axis=-1) - along * along, _TINY_M**2))
            return v, along, across, across * cos - along * sin

        def residuals(ground: Array) -> Array:
            return distances(ground)[3]

        def jacobian(ground: Array) -> Array:
            v, along, across, _ = distances(ground)
            gradient: Array = cos[:, None] * (v - along[:, None] * axis) / across[:, None] - sin[:, None] * axis
            return gradient[:, :2] + gradient[:, 2:] * self.ground.slopes(ground[None])

        costs = np.sum(residuals(self._grid) ** 2, axis=-1)
        best = self._grid[int(np.argmin(costs))]
        found = least_squares(residuals, best, jac=jacobian, bounds=(self._lower, self._upper))
        if np.all(np.isfinite(found.x)) and 2.0 * found.cost <= costs.min():
            best = found.x
        return float(best[0]), float(best[1])
