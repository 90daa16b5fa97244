"""Photons scattered by soil beside a source, in the bins of the exposures' coarse spectra: H, I and J of ``spectra``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from radron.agent.fusion.facing import MEAN_STEEPNESS
from radron.agent.fusion.sources.bins import pooled, scaled
from radron.agent.fusion.sources.soiltables import SOIL
from radron.agent.geometry import Array

SOIL_SHAPES = 3  # H, I and J


class Sight(NamedTuple):
    """A camera's view of a source. depth: mu d; facing: f - ``MEAN_FACING``; steepness: h; soil: r. Of any shapes."""

    depth: Array | float = 0.0
    facing: Array | float = 0.0
    steepness: Array | float = MEAN_STEEPNESS
    soil: float = 1.0


@dataclass(frozen=True, eq=False)
class Soil:
    """Soil's scatter H, I and J, and the derivatives of H and I by the logarithm of the energy scale: (N + U, BINS) each."""

    near: Array
    steep: Array
    turned: Array
    near_by_scale: Array
    steep_by_scale: Array

    def templates(self, scale: float) -> Array:
        """Return (N + U, 3, BINS) H, I and J at the energy scale's error."""
        near = scaled(self.near, self.near_by_scale, scale)
        return np.stack((near, self.steep + scale * self.steep_by_scale, self.turned), axis=1)

    @classmethod
    def of(cls, nuclides: Sequence[str]) -> Soil:
        """Return the tables of these nuclides."""
        keys = "near", "steep", "turned", "near_by_scale", "steep_by_scale"
        return cls(*(pooled(np.array([SOIL[name][key] for name in nuclides])) for key in keys))
