"""Counts of photons scattered by soil and air beside a source on or above the ground, and of the soil's own photons.

Soil scatters as if the photons came from an image of the source, ``IMAGE_DEPTH`` h below the ground for a source h above it.
With the image at the distance D', the sine s of its depression below the horizon and the facing f to it, a channel counts

    phi(D) (D / D')^2 (near + steep s) (1 + turn (f - ``MEAN_FACING``))     of photons scattered by soil,
    phi(D) air mu D     of photons scattered by air, and ``BODY_SHARE`` of those by vehicle and mount; phi as of ``response``.

The table is from ``python benchmarks/ground_response.py --events 250 --photons 60000``: a separate transport code, independent of
the simulation's, folded with the simulated sensor's response. The formula fits it within 5 % (root mean square) up to a metre
above the ground. Unknown on board are kind, moisture and roughness of the ground, and the depth of the source. A track fits a
factor of 0.5 to 1.5 on near and steep for them (``spectrum``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radron.agent.fusion.facing import MEAN_FACING
from radron.agent.geometry import Array

BODY_SHARE = 0.25  # vehicle and mount scatter a quarter of the scatter assumed for the surroundings over nothing
SCATTER_SIGMA = 0.3  # of the logarithm of the scatter factor
HEIGHT_SIGMA_M = 0.5  # of the source above the ground
IMAGE_DEPTH = 1.2  # per height of the source: 1.1 to 1.3 by nuclide
OTHER_SHARE = 0.2  # background of another origin than soil, as a share of the background over nothing


@dataclass(frozen=True, slots=True)
class SoilChannel:
    """Constants of one kind of event (channel of the camera's counts) for photons scattered by soil and air, and for natural
    background.

    Soil scatters as if the photons came from an image of the source below the ground; the effective area is (near + steep s) (1 +
    turn (f - mean)), with s the sine of the image's depression below the horizon, and f the cosine of the sensor's orientation to
    the image. near_mm2, steep_mm2, turn: these constants. air_mm2: effective area for photons scattered by air. background_ps:
    background per second over soil.
    """

    near_mm2: float
    steep_mm2: float
    air_mm2: float
    turn: float
    background_ps: float


class SoilTable:
    """Expected counts of photons scattered by soil, air and vehicle, and of background over soil, for the C channels of
    a camera.
    """

    def __init__(self, channels: tuple[SoilChannel, ...], body_mm2: Array, alone_ps: Array) -> None:
        """Set up the table.

        body_mm2, alone_ps: (C,) areas for photons scattered by vehicle and mount, and background per second without soil.
        """
        table = np.array([(c.near_mm2, c.steep_mm2, c.air_mm2, c.turn, c.background_ps) for c in channels]).T
        self._near, self._steep, self._air, self._turn, own_ps = table
        self._body_mm2 = body_mm2
        self.background_ps: Array = own_ps + OTHER_SHARE * alone_ps

    def by_soil(self, fluence: Array, steepness: Array, facing: Array | float) -> Array:
        """Return the expected counts (..., C) of photons scattered by soil.

        Soil scatters as if the photons came from an image of the source below the ground. fluence: (...) as of
        ``Response.parts``, but at the image's distance. steepness, facing: (...) sine s of the image's depression below the
        horizon, and cosine f of the sensor's orientation to the image.
        """
        turned = 1.0 + self._turn * (np.asarray(facing)[..., None] - MEAN_FACING)
        mm2 = np.maximum(self._near + self._steep * steepness[..., None], 0.0) * turned
        result: Array = mm2 * fluence[..., None]
        return result

    def slope(self, image: Array, distance: Array, steepness: Array) -> Array:
        """Return the derivatives (..., 3) of the logarithm of soil's scatter along the vector ``image`` (..., 3) to the source's
        image.

            -(2 + g) image / D'^2,   and along z also g / image_z,   g = steep s / (near + steep s).

        The sensor's orientation is left out. distance: (...) D' to the image. steepness: (...) s.
        """
        steep = self._steep.sum() * steepness
        growing = steep / (self._near.sum() + steep)
        result: Array = -((2.0 + growing) / (distance * distance))[..., None] * image
        result[..., 2] += growing / image[..., 2]
        return result

    def beside_soil(self, fluence: Array, depth: Array) -> Array:
        """Return the expected counts (..., C) of photons scattered by air, vehicle and mount.

        fluence: (...) as of ``Response.parts``. depth: (...) optical depth mu D of the air.
        """
        result: Array = (self._air * depth[..., None] + self._body_mm2) * fluence[..., None]
        return result


def _soil(*rows: tuple[float, float, float, float, float]) -> tuple[SoilChannel, SoilChannel]:
    partial, full = (SoilChannel(*row) for row in rows)
    return partial, full


# partial- and full-energy events: near, steep, air, turn, background
SOIL: dict[str, tuple[SoilChannel, SoilChannel]] = {
    "Cs-137": _soil(
        (2.02, 45.2, 170.0, 0.742, 4.74),
        (0.0867, -0.126, 0.966, 0.999, 0.04),
    ),
    "Co-60": _soil(
        (1.12, 35.7, 159.0, 0.683, 4.75),
        (0.0147, -0.0242, 0.366, 0.956, 0.027),
    ),
    "I-131": _soil(
        (2.79, 57.8, 196.0, 0.84, 4.5),
        (3.88, -3.11, 2.99, 0.334, 0.274),
    ),
    "Ir-192": _soil(
        (2.89, 58.1, 201.0, 0.843, 4.51),
        (2.87, -2.48, 4.68, 0.404, 0.265),
    ),
    "Na-22": _soil(
        (2.06, 44.6, 172.0, 0.74, 4.71),
        (0.578, -0.548, 1.23, 0.261, 0.0717),
    ),
}
