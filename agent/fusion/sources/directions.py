"""The likelihood of the cones, given that they were registered: a mixture over the sources and the background.

    log [(sum_k w_k (K_k (rho_k + eps) + A_k) + B) / (sum_k w_k (K_k + A_k) + B)]

w_k as in ``spectra``, K_k and A_k the areas for cones of this line that point to source k, of which known walls let a share pass,
and that do not, B the background's rate, rho_k and eps as in ``fusion.bayes.cones``. That a cone came at all is not counted here:
its event is in the exposure's spectrum. The information is estimated by the outer products of the cones' gradients.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agent.detector.windows import Windows
from agent.fusion.bayes.cones import OUTLIER_FRACTION
from agent.fusion.sources.data import Cones
from agent.fusion.sources.shades import KnownWalls, Shades
from agent.fusion.sources.solution import Solution
from agent.fusion.sources.spectra import NEAREST_M, PER_MM2, Spectra
from agent.geometry import Array
from agent.terrain.ground import Ground

_PER_ROOT_TWO_PI = (2.0 * np.pi) ** -0.5
_LEAST_SINE = 1e-3


class ConeModel:
    """The cones with the areas for their lines."""

    def __init__(
        self, cones: Cones, spectra: Spectra, ground: Ground, drones: int, windows: Windows, walls: KnownWalls | None = None
    ) -> None:
        """``windows``: in which the detector takes coincidences for a line's."""
        self._shades = Shades(walls, cones.apex) if walls and len(cones) else None
        self._cones, self._spectra, self._ground, self._drones = cones, spectra, ground, drones
        lines = np.array([window.energy_kev for window in windows.each])
        index = np.abs(cones.energy_kev[:, None] - lines).argmin(axis=1)
        of_lines = [
            spectra.cones(window.energy_kev, windows.reach_kev(place), window.unsure_kev)
            for place, window in enumerate(windows.each)
        ]
        self._pointing = np.array([one[0] for one in of_lines])[index]  # (C, N)
        self._other = np.array([one[1] for one in of_lines])[index]
        self._own = [np.flatnonzero(one) for one in self._pointing.T]  # of each nuclide, the cones that may point to it
        self._background = np.array([one[2] for one in of_lines])[index]  # (C,)
        self._precision = 1.0 / cones.variance
        self._height = cones.weight * np.sqrt(self._precision) * _PER_ROOT_TWO_PI

    def log_likelihood(self, solution: Solution) -> float:
        """Relative to cones from anywhere."""
        if not len(self._cones) or not len(solution):
            return 0.0
        above = below = self._background * np.exp(solution.log_background)
        for k in range(len(solution)):
            seen, missed, _, _ = self._source(solution, k)
            above, below = above + seen, below + missed
        return float(np.log(above / below).sum())

    def scored(self, solution: Solution) -> tuple[float, Array, Array]:
        """As ``CountModel.scored``."""
        each, free = solution.size, [0, 1] if solution.height is None else [0, 1, 3]
        size = each * len(solution) + 1
        if not len(self._cones) or not len(solution):
            return 0.0, np.zeros((self._drones, size)), np.zeros((self._drones, size, size))
        background = self._background * np.exp(solution.log_background)
        parts = [self._source(solution, k) for k in range(len(solution))]
        above = background + sum(part[0] for part in parts)
        below = background + sum(part[1] for part in parts)
        gradient = np.empty((len(self._cones), size))
        for k, (seen, missed, by_place, weakening) in enumerate(parts):
            share = seen / above - missed / below
            gradient[:, [each * k + part for part in free]] = by_place / above[:, None] + share[:, None] * weakening
            gradient[:, each * k + 2] = share
        gradient[:, -1] = background / above - background / below
        return float(np.log(above / below).sum()), *_parts_by_drone(self._drones, self._cones.drone, gradient)

    def _source(self, solution: Solution, k: int) -> tuple[Array, Array, Array, Array]:
        """Of source k for each cone: its terms (C,) above and below the line; w K times the derivative (C, 2) of rho by x and y,
        or (C, 3) by x, y and height; the derivative of log w by the same.
        """
        x, y = solution.place[k].tolist()
        rise = np.array(self._ground.slope(x, y))
        source = x, y, self._ground.height_m(x, y) + solution.height_of(k)
        way = np.array(source) - self._cones.apex
        way[:, :2] += solution.bias[self._cones.drone, :2]
        distance = np.maximum(np.sqrt((way**2).sum(axis=1)), NEAREST_M)
        n = solution.nuclide[k]
        air = self._spectra.air_per_m[n]
        w = PER_MM2 * np.exp(solution.log_activity[k] - air * distance) / distance**2
        unit = way / distance[:, None]
        own = self._own[n]
        directed, by_way = self._directed(own, unit[own], distance[own])
        pointing, other = w * self._pointing[:, n], w * self._other[:, n]
        if self._shades is not None:
            pointing *= self._shades.passing(n, source)
        weakening = _by_place(-(2.0 / distance + air)[:, None] * unit, rise, solution)
        seen, turned = OUTLIER_FRACTION * pointing + other, np.zeros_like(weakening)
        seen[own] += pointing[own] * directed
        turned[own] = pointing[own, None] * _by_place(by_way, rise, solution)
        return seen, pointing + other, turned, weakening

    def _directed(self, own: NDArray[np.intp], unit: Array, distance: Array) -> tuple[Array, Array]:
        """rho of C of the cones, ``own``, and its derivative (C, 3) by the way from the camera to the source, 1/m; unit: (C, 3)
        of that way.
        """
        axis, precision = self._cones.axis[own], self._precision[own]
        cosine = np.clip(np.einsum("cki,ci->ck", axis, unit), -1.0, 1.0)
        off = (np.arccos(cosine) - self._cones.theta[own])[..., None]
        density = self._height[own] * np.exp(-0.5 * off * off * precision)
        slope = -(density * off * precision).sum(axis=2)  # of rho, by each reading's angle
        sine = np.maximum(np.sqrt(1.0 - cosine * cosine), _LEAST_SINE)
        turn = -(axis - cosine[..., None] * unit[:, None, :]) / (sine * distance[:, None])[..., None]
        return density.sum(axis=(1, 2)), (slope[..., None] * turn).sum(axis=1)


def _by_place(by_way: Array, rise: Array, solution: Solution) -> Array:
    """Derivatives (C, 2) by a source's x and y, or (C, 3) by those and its height, from those (C, 3) by the way to it."""
    flat = by_way[:, :2] + by_way[:, 2:] * rise
    return flat if solution.height is None else np.column_stack((flat, by_way[:, 2]))


def _parts_by_drone(drones: int, drone: NDArray[np.int64], gradient: Array) -> tuple[Array, Array]:
    """Sums (V, p) of gradients (N, p), and (V, p, p) of their outer products, by drone (N,)."""
    chosen = [gradient[drone == number] for number in range(drones)]
    return np.array([part.sum(axis=0) for part in chosen]), np.array([part.T @ part for part in chosen])
