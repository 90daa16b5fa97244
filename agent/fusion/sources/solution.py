"""What is fitted: the sources, and with them the errors of background, positions, sensitivities, energies and scatter."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from agent.geometry import Array

SOURCE = 3  # numbers of each source: x, y (m), logarithm of the activity / REFERENCE_BQ
BIAS = 3  # of each drone: x, y (m), measured minus true; logarithm of its camera's sensitivity


class Solution(Struct, frozen=True, eq=False):
    """K sources and the nuisances of V drones.

    nuclide: indices among the candidates. place: (K, 2) metres, mission frame. log_activity: (K,). log_background: of the ratio
    between actual and assumed background. bias: (V, BIAS). scale: error of the energies; scatter: excess of scattered photons.
    """

    nuclide: tuple[int, ...]
    place: Array
    log_activity: Array
    log_background: float
    bias: Array
    scale: float = 0.0
    scatter: float = 0.0

    @classmethod
    def nothing(cls, drones: int) -> Solution:
        """No source, no errors."""
        return cls((), np.zeros((0, 2)), np.zeros(0), 0.0, np.zeros((drones, BIAS)))

    def __len__(self) -> int:
        return len(self.nuclide)

    @property
    def vector(self) -> Array:
        """(3 K + 1 + 3 V,) all but scale and scatter."""
        sources = np.column_stack((self.place, self.log_activity)).ravel()
        return np.concatenate((sources, [self.log_background], self.bias.ravel()))

    def moved(self, vector: Array) -> Solution:
        """With these values in the place of ``vector``."""
        count = SOURCE * len(self)
        sources = vector[:count].reshape(-1, SOURCE)
        return replace(
            self,
            place=sources[:, :2],
            log_activity=sources[:, 2],
            log_background=float(vector[count]),
            bias=vector[count + 1 :].reshape(-1, BIAS),
        )

    def plus(self, nuclide: int, place: Array, log_activity: float) -> Solution:
        """With a further source at the end."""
        return replace(
            self,
            nuclide=(*self.nuclide, nuclide),
            place=np.vstack((self.place, place)),
            log_activity=np.append(self.log_activity, log_activity),
        )

    def only(self, kept: list[int]) -> Solution:
        """With these of the sources, in this order."""
        return replace(
            self,
            nuclide=tuple(self.nuclide[k] for k in kept),
            place=self.place[kept],
            log_activity=self.log_activity[kept],
        )

    def without(self, gone: int) -> Solution:
        """Without one of the sources."""
        return self.only([k for k in range(len(self)) if k != gone])
