"""The likelihood of the registered cones: a mixture over the sources and the background.

    log [(sum_k w_k (K_k (rho_k + eps) + A_k) + B) / (sum_k w_k (K_k + A_k) + B)]

w_k as in ``spectra``, K_k and A_k the areas for cones of this line that do or do not point to source k, B the background's rate,
rho_k and eps as in ``fusion.bayes.cones``. Known walls let a share of K_k pass. The likelihood is conditional on the cone's
registration: its event counts in the exposure's spectrum. The information is estimated by the outer products of the cones'
gradients.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from radron.agent.detector.windows import Windows
from radron.agent.fusion.bayes.cones import OUTLIER_FRACTION
from radron.agent.fusion.sources.counts import Derivatives
from radron.agent.fusion.sources.data import Cones
from radron.agent.fusion.sources.shades import KnownWalls, Shades
from radron.agent.fusion.sources.solution import Solution
from radron.agent.fusion.sources.spectra import NEAREST_M, PER_MM2, Spectra
from radron.agent.geometry import Array
from radron.agent.terrain.ground import Ground

_PER_ROOT_TWO_PI = (2.0 * np.pi) ** -0.5
_LEAST_SINE = 1e-3


class _Source(NamedTuple):
    """A source in the view of C cones, D of which may point to it.

    own: (D,) their indices. unit: (C, 3) of the vector from the camera to the source, and distance: (C,) its length, metres.
    cosine: (D, 2) of the angle to each reading's axis; off: (D, 2, 1) that angle minus the cone's; density: (D, 2, 2), the terms
    of rho. pointing: (C,) w K. seen, missed: (C,) terms above and below the line. weakening: (C,) derivative of log w by the
    distance.
    """

    own: NDArray[np.intp]
    unit: Array
    distance: Array
    cosine: Array
    off: Array
    density: Array
    pointing: Array
    seen: Array
    missed: Array
    weakening: Array


class ConeModel:
    """The cones with the areas for their lines."""

    def __init__(
        self, cones: Cones, spectra: Spectra, ground: Ground, drones: int, windows: Windows, walls: KnownWalls | None = None
    ) -> None:
        """``windows``: energy windows in which the detector assigns coincidences to a line."""
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
        """Return the log likelihood, relative to cones from anywhere."""
        return self.scored(solution)[0]

    def scored(self, solution: Solution) -> tuple[float, Derivatives]:
        """Return log likelihood and derivatives, as ``CountModel.scored``."""
        size = solution.unbiased
        if not len(self._cones) or not len(solution):
            return 0.0, lambda: (np.zeros((self._drones, size)), np.zeros((self._drones, size, size)))
        background = self._background * np.exp(solution.log_background)
        sources = [self._source(solution, k) for k in range(len(solution))]
        above = background + sum(one.seen for one in sources)
        below = background + sum(one.missed for one in sources)
        return float(np.log(above / below).sum()), lambda: self._derived(solution, sources, background, above, below)

    def _derived(
        self, solution: Solution, sources: Sequence[_Source], background: Array, above: Array, below: Array
    ) -> tuple[Array, Array]:
        """Return gradients (V, p) and informations (V, p, p) by drone."""
        each, free = solution.size, [0, 1] if solution.height is None else [0, 1, 3]
        gradient = np.zeros((len(self._cones), solution.unbiased))
        for k, one in enumerate(sources):
            rise = np.array(self._ground.slope(*solution.place[k].tolist()))
            weakening = _by_place(one.weakening[:, None] * one.unit, rise, solution)
            turned = one.pointing[one.own, None] * _by_place(self._turned(one), rise, solution)
            share = one.seen / above - one.missed / below
            by_place = share[:, None] * weakening
            by_place[one.own] += turned / above[one.own, None]
            gradient[:, [each * k + part for part in free]] = by_place
            gradient[:, each * k + 2] = share
        gradient[:, solution.of_sources] = background / above - background / below
        return _parts_by_drone(self._drones, self._cones.drone, gradient)

    def _source(self, solution: Solution, k: int) -> _Source:
        """Return source k in the view of the cones."""
        x, y = solution.place[k].tolist()
        source = x, y, self._ground.height_m(x, y) + solution.height_of(k)
        way = np.array(source) - self._cones.apex
        way[:, :2] += solution.bias[self._cones.drone, :2]
        distance = np.maximum(np.sqrt((way**2).sum(axis=1)), NEAREST_M)
        n = solution.nuclide[k]
        air = self._spectra.air_per_m[n]
        w = PER_MM2 * np.exp(solution.log_activity[k] - air * distance) / distance**2
        unit = way / distance[:, None]
        own = self._own[n]
        cosine = np.clip(np.einsum("cki,ci->ck", self._cones.axis[own], unit[own]), -1.0, 1.0)
        off = (np.arccos(cosine) - self._cones.theta[own])[..., None]
        density = self._height[own] * np.exp(-0.5 * off * off * self._precision[own])
        pointing, other = w * self._pointing[:, n], w * self._other[:, n]
        if self._shades is not None:
            pointing *= self._shades.passing(n, source)
        seen = OUTLIER_FRACTION * pointing + other
        seen[own] += pointing[own] * density.sum(axis=(1, 2))
        return _Source(own, unit, distance, cosine, off, density, pointing, seen, pointing + other, -(2.0 / distance + air))

    def _turned(self, one: _Source) -> Array:
        """Return the derivative (D, 3) of rho by the vector from the camera to the source, 1/m, of the D cones that may point to
        it.
        """
        unit, distance = one.unit[one.own], one.distance[one.own]
        slope = -(one.density * one.off * self._precision[one.own]).sum(axis=2)  # of rho, by each reading's angle
        sine = np.maximum(np.sqrt(1.0 - one.cosine * one.cosine), _LEAST_SINE)
        turn = -(self._cones.axis[one.own] - one.cosine[..., None] * unit[:, None, :]) / (sine * distance[:, None])[..., None]
        result: Array = (slope[..., None] * turn).sum(axis=1)
        return result


def _by_place(by_way: Array, rise: Array, solution: Solution) -> Array:
    """Return derivatives (C, 2) by a source's x and y, or (C, 3) with its height, from derivatives (C, 3) by the vector to it."""
    flat = by_way[:, :2] + by_way[:, 2:] * rise
    return flat if solution.height is None else np.column_stack((flat, by_way[:, 2]))


def _parts_by_drone(drones: int, drone: NDArray[np.int64], gradient: Array) -> tuple[Array, Array]:
    """Return sums (V, p) of gradients (N, p), and sums (V, p, p) of their outer products, by drone (N,)."""
    chosen = [gradient[drone == number] for number in range(drones)]
    return np.array([part.sum(axis=0) for part in chosen]), np.array([part.T @ part for part in chosen])
