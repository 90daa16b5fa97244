"""Photons scattered by the ground beside a source, in the bins of the exposures' coarse spectra: H, I and J of ``spectra``.

The tables are of soil. Other grounds, and soils of other moisture and roughness, scatter in bin e, of mean energy about E,

    exp(r + c g_e),    g_e = mean of (60 keV / E)^3 over the bin,

times as many photons. Before soft photons leave the ground it absorbs many of them by the photoelectric effect, which falls as
E^-3 beside the scattering, and rises with the ground's mean atomic number. So c tells the composition: 0 for soil, about 0.1 for
sand and asphalt, -0.03 for concrete, and 0.35 for water. By nuclide c differs: 0.3 to 0.4 for water and lines above 300 keV, 0.13
to 0.2 for Am-241 and Ba-133. With r and c the table of soil explains the scatter of these grounds to 3 % (root mean square over
six nuclides), with r alone that of water only to 15 to 22 % (``python benchmarks/soil_spectra.py --grounds``). The ground's own
photons depend on c in the same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from radron.agent.fusion.bayes.soil import SCATTER_SIGMA
from radron.agent.fusion.facing import MEAN_STEEPNESS
from radron.agent.fusion.sources.bins import pooled, scaled
from radron.agent.fusion.sources.soiltables import SOIL
from radron.agent.geometry import Array
from radron.protocol.spectrum import BINS, EDGES_KEV

SOIL_SHAPES = 3  # H, I and J
SOFT_KEV = 60.0  # where g is 1


def softness() -> Array:
    """Return g, (BINS,)."""
    edges = np.array(EDGES_KEV)
    return pooled(0.5 * SOFT_KEV**3 * (edges[:-1] ** -2 - edges[1:] ** -2) / np.diff(edges))


SOFT: Final[Array] = softness()
BY_NUMBER: Final[Array] = np.stack((np.ones(BINS), SOFT))  # (2, BINS) derivatives of the scatter's logarithm by r and c
SOIL_SIGMA = (SCATTER_SIGMA, 0.2)  # of r, and of c over the five grounds above
NO_SOIL: Final[Array] = np.zeros(0)  # r and c where there is no ground
AS_TABULATED: Final[Array] = np.zeros(2)


class Sight(NamedTuple):
    """A camera's view of a source. depth: mu d; facing: f - ``MEAN_FACING``; steepness: h. Of any shapes."""

    depth: Array | float = 0.0
    facing: Array | float = 0.0
    steepness: Array | float = MEAN_STEEPNESS


@dataclass(frozen=True, eq=False)
class Soil:
    """Soil's scatter H, I and J, and the derivatives of H and I by the logarithm of the energy scale: (N + U, BINS) each.

    own: (BINS,) share of soil's own photons in the background.
    """

    near: Array
    steep: Array
    turned: Array
    near_by_scale: Array
    steep_by_scale: Array
    own: Array

    def templates(self, scale: float, soil: Array) -> Array:
        """Return (N + U, 3, BINS) H, I and J at the energy scale's error. ``soil``: (2,) r and c."""
        near = scaled(self.near, self.near_by_scale, scale)
        result: Array = np.stack((near, self.steep + scale * self.steep_by_scale, self.turned), axis=1) * factor(soil)
        return result

    def background(self, soil: Array) -> tuple[Array, Array]:
        """Return the background relative to the table's (BINS,), and its derivative by c. ``soil``: (2,) r and c."""
        own = self.own * np.exp(soil[1] * SOFT)
        return 1.0 - self.own + own, own * SOFT

    @classmethod
    def of(cls, nuclides: Sequence[str], own: Array) -> Soil:
        """Return the tables of these nuclides. ``own``: as the field."""
        keys = "near", "steep", "turned", "near_by_scale", "steep_by_scale"
        return cls(**{key: pooled(np.array([SOIL[name][key] for name in nuclides])) for key in keys}, own=own)


def factor(soil: Array) -> Array:
    """Return (BINS,) scattered photons relative to the table. ``soil``: (2,) r and c."""
    result: Array = np.exp(soil @ BY_NUMBER)
    return result
