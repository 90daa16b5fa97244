"""Transmission of known walls and buildings for a source's direct photons, given the uncertainty of the source's place."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from radron.agent.geometry import Array
from radron.agent.terrain.buildings import Buildings

_MAP_SIGMA = 0.03  # relative, of the optical depth: a map's thicknesses and densities
_MAX_SIGMA_M = 5.0  # of the sigmas; beyond it, the obstacles in between are unknown


class Shielding(NamedTuple):
    """The share T (S, M) of a source's direct photons that passes known walls and buildings, and its 1 sigma (S, M).

    S sites (candidate places of the source), M motion modes.
    """

    share: Array
    sigma: Array

    @staticmethod
    def of(buildings: Buildings, start: Array, way: Array, sigma_m: Array) -> Shielding:
        """Compute the share that passes, as mean over the source's place and four more places, one sigma to each side along both
        axes.

            T = mean_i T_i,  sigma^2 = sum over the axes of ((T_+ - T_-) / 2)^2 + (0.03 depth T)^2,  T_i = exp(-depth_i).

        depth_i: optical depth of the buildings for place i; T_+, T_-: at the places one sigma to each side. start, way: (S, M,
        3), place of the camera, and vector from there to the source. sigma_m: (S, M, 2) of the source's x and y.
        """
        sides = np.zeros((5, *way.shape))
        for axis in range(2):
            sides[1 + 2 * axis, ..., axis] = np.minimum(sigma_m[..., axis], _MAX_SIGMA_M)
            sides[2 + 2 * axis] = -sides[1 + 2 * axis]
        ways = (way + sides).reshape(-1, 3)
        depth = buildings.depth(np.broadcast_to(start, sides.shape).reshape(-1, 3), ways).reshape(sides.shape[:-1])
        passing = np.exp(-depth)
        across = ((passing[1] - passing[2]) ** 2 + (passing[3] - passing[4]) ** 2) / 4.0
        return Shielding(passing.mean(axis=0), np.sqrt(across + (_MAP_SIGMA * depth[0] * passing[0]) ** 2))

    def counts(self, direct: Array, scattered: Array) -> tuple[Array, Array]:
        """Return the counts (S, M, 2) expected behind the buildings, and the variance (S, M) of the logarithm of their sum by
        sigma.

        Buildings attenuate direct photons; scattered photons come from all sides. direct, scattered: (S, M, 2) without buildings.
        """
        behind = direct * self.share[..., None] + scattered
        return behind, (direct.sum(axis=-1) * self.sigma / behind.sum(axis=-1)) ** 2
