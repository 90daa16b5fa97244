"""What a camera is expected to count of a source: rates of hits, full-energy events, coincidences and cones.

Effective areas are nearly the same from all sides (reference, "Detector"), so the camera's attitude does not enter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

AIR_PER_M = 0.00934  # attenuation of the 662 keV line in air
PHOTONS_PER_DECAY = 0.851  # of Cs-137
REFERENCE_BQ = 1e9  # activities are counted in units of it


@dataclass(frozen=True, slots=True)
class Channel:
    """One thing that is counted. Expected counts per second: S + B with
    S = photons per mm2 and s x area_mm2 x (direct + scattered x depth), depth = attenuation x distance.

    ``trust``: power to which the channel's likelihood is taken; below 1 where its errors are not independent of the others'.
    """

    area_mm2: float
    direct: float
    scattered: float
    background_ps: float
    trust: float


# Areas and backgrounds as a camera next to a known source counts them in the chain of agent.detector; the reference's table has
# the areas before clustering and without fluorescence, which splits some events in two.
HITS = Channel(18.4, 1.2, 0.8, 1.5, 0.5)
PHOTOPEAK = Channel(2.75, 1.0, 0.3, 0.03, 1.0)
COINCIDENCES = Channel(1.9, 1.0, 0.3, 0.03, 1.0)
CHANNELS = (HITS, PHOTOPEAK, COINCIDENCES)  # in the order of an exposure's counts
CONE_AREA_MM2 = 0.55
CONE_BACKGROUND_PS = 0.004


@dataclass(frozen=True, slots=True)
class Response:
    """What a camera counts of one nuclide."""

    channels: tuple[Channel, ...]
    air_per_m: float
    photons_per_decay: float
    cone_area_mm2: float
    cone_background_ps: float

    @property
    def background_ps(self) -> Array:
        """(3,) of the channels."""
        return np.array([c.background_ps for c in self.channels])

    def flux(self, distance_m: Array) -> Array:
        """Unscattered photons per mm2 and second at a distance from REFERENCE_BQ; any shape."""
        result: Array = (
            REFERENCE_BQ * self.photons_per_decay / (4e6 * np.pi) * np.exp(-self.air_per_m * distance_m) / distance_m**2
        )
        return result

    def signal(self, fluence: Array, distance_m: Array) -> Array:
        """Expected counts (..., 3) of the channels from photons per mm2 (...) that came from a distance (...)."""
        depth = self.air_per_m * distance_m
        return np.stack([c.area_mm2 * (c.direct + c.scattered * depth) * fluence for c in self.channels], axis=-1)


def response_of(nuclide: str) -> Response:
    """Response."""
    return Response(CHANNELS, AIR_PER_M, PHOTONS_PER_DECAY, CONE_AREA_MM2, CONE_BACKGROUND_PS)
