"""The fitted numbers: the sources, and the errors of background, ground, positions, sensitivities, energies and scatter."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from radron.agent.fusion.sources.soil import AS_TABULATED, NO_SOIL
from radron.agent.geometry import Array

SOURCE = 3  # numbers of each source on the ground: x, y (m), log (activity / REFERENCE_BQ); above it, also its height (m)
BIAS = 3  # of each drone: x, y (m), measured minus true; logarithm of its camera's sensitivity


class Solution(Struct, frozen=True, eq=False):
    """K sources and the nuisances of V drones.

    nuclide: indices among the candidates. place: (K, 2) metres, mission frame. log_activity: (K,). log_background: logarithm of
    the ratio between actual and assumed background. bias: (V, BIAS). scale: error of the energies; scatter: excess of scattered
    photons. height: (K,) metres above the ground; None: all are known to lie on it. soil: (2,) strength and composition of the
    ground's scatter, r and c of ``soil``; (0,): there is no ground.
    """

    nuclide: tuple[int, ...]
    place: Array
    log_activity: Array
    log_background: float
    bias: Array
    scale: float = 0.0
    scatter: float = 0.0
    height: Array | None = None
    soil: Array = NO_SOIL

    @classmethod
    def nothing(cls, drones: int, *, raised: bool = False, over_soil: bool = False) -> Solution:
        """Return a solution without source and errors. ``raised``: sources may be above the ground."""
        height, soil = np.zeros(0) if raised else None, AS_TABULATED if over_soil else NO_SOIL
        return cls((), np.zeros((0, 2)), np.zeros(0), 0.0, np.zeros((drones, BIAS)), height=height, soil=soil)

    def __len__(self) -> int:
        return len(self.nuclide)

    @property
    def size(self) -> int:
        """Numbers of each source: ``SOURCE``, and one more with a fitted height."""
        return SOURCE if self.height is None else SOURCE + 1

    def height_of(self, k: int) -> float:
        """Return the height of source k above the ground, metres."""
        return 0.0 if self.height is None else float(self.height[k])

    @property
    def of_sources(self) -> int:
        """Numbers of all sources, the first ones of ``vector``."""
        return self.size * len(self)

    @property
    def unbiased(self) -> int:
        """Numbers before the drones' biases in ``vector``: the sources', the background's and, over soil, the soil's."""
        return self.of_sources + 1 + len(self.soil)

    @property
    def vector(self) -> Array:
        """(``unbiased`` + 3 V,) all numbers but scale and scatter."""
        columns = (self.place, self.log_activity) if self.height is None else (self.place, self.log_activity, self.height)
        return np.concatenate((np.column_stack(columns).ravel(), [self.log_background], self.soil, self.bias.ravel()))

    def moved(self, vector: Array) -> Solution:
        """Return the solution with these values in the place of ``vector``."""
        count = self.of_sources
        sources = vector[:count].reshape(-1, self.size)
        return replace(
            self,
            place=sources[:, :2],
            log_activity=sources[:, 2],
            log_background=float(vector[count]),
            bias=vector[self.unbiased :].reshape(-1, BIAS),
            height=None if self.height is None else sources[:, 3],
            soil=vector[count + 1 : self.unbiased],
        )

    def plus(self, nuclide: int, place: Array, log_activity: float, height: float = 0.0) -> Solution:
        """Return the solution with a further source at the end."""
        return replace(
            self,
            nuclide=(*self.nuclide, nuclide),
            place=np.vstack((self.place, place)),
            log_activity=np.append(self.log_activity, log_activity),
            height=None if self.height is None else np.append(self.height, height),
        )

    def only(self, kept: list[int]) -> Solution:
        """Return the solution with these of the sources, in this order."""
        return replace(
            self,
            nuclide=tuple(self.nuclide[k] for k in kept),
            place=self.place[kept],
            log_activity=self.log_activity[kept],
            height=None if self.height is None else self.height[kept],
        )

    def without(self, gone: int) -> Solution:
        """Return the solution without one of the sources."""
        return self.only([k for k in range(len(self)) if k != gone])
