"""The initial hypothesis x0 from M cones: non-linear least squares (paper, Sec. V-A; Baca et al., "Gamma radiation source
localization for micro aerial vehicles with a miniature single-detector Compton event camera", ICUAS 2021, arXiv:2011.03356).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares
from shapely import Point, Polygon, contains_xy

from radron.agent.fusion.observation import ConeSurface
from radron.agent.geometry import Array
from radron.agent.terrain.ground import LEVEL, Ground

GRID_PITCH_M = 2.0
_TINY_M = 1e-9  # floor of ``across``, for a finite gradient on a cone's axis


class InitialSearch:
    """Finds the first source estimate x0: the point on the ground of the area with the least sum of squared distances to M cones.

        x0 = argmin_p sum_m r_m(p)^2,   r_m = |v_m| sin(alpha_m - theta_m),   v_m = p - apex_m,   alpha_m = angle(v_m, axis_m),

    p = (x, y, ground height), theta_m the opening angle of cone m. With along = v . axis = |v| cos(alpha) and across = |v - along
    axis| = |v| sin(alpha),

        r = across cos(theta) - along sin(theta)
        dr/dv = cos(theta) (v - along axis) / across - sin(theta) axis
        dr/dx = (dr/dv)_x + (dr/dv)_z dz/dx      (likewise y): the ground takes p up and down.

    r is the distance to the cone's surface while |alpha - theta| < 90 deg, beyond that to the surface's continuation behind the
    apex. The search starts from the best point of a grid over the area, because the sum of squares has local minima, for example
    at the apexes (paper, Sec. V-B). The search stays in the area's bounding box, because nearly parallel cones leave the distance
    along them undetermined. The result is never worse than the best grid point.
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
        """Return the first source estimate (x, y) from these cones, mission frame, metres; bit-identical for equal cones."""
        apex = np.array([cone.apex for cone in cones])
        axis = np.array([cone.axis for cone in cones])
        theta = np.array([cone.theta_rad for cone in cones])
        cos, sin = np.cos(theta), np.sin(theta)

        def distances(ground: Array) -> tuple[Array, Array, Array, Array]:
            """Return v (..., M, 3), along, across and r, (..., M) each, of points (..., 2)."""
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
