"""What a camera counts of photons that soil and air scatter beside a source on the ground, and of the soil's own.

Per photon from the source, as of ``response``, with f the facing, s the sine of the source's depression below the horizon, and
``turn``, ``near``, ``steep`` and ``air`` the table's: a channel counts of scattered photons

    phi(D) [(near + steep s) (1 + turn (f - 0.565)) + air mu D]  and of photons that vehicle and mount scatter, ``BODY_SHARE``.

The table is that of ``python -m benchmarks.ground_response --events 250 --photons 60000``: a transport code of its own, which is
not the simulation's, folded with the simulated sensor's response. Unknown on board are kind, moisture and roughness of the
ground, and how deep the source lies: a factor of 0.5 to 1.5 on near and steep, which a track fits (``spectrum``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from agent.geometry import Array

BODY_SHARE = 0.25  # vehicle and mount scatter a quarter of what the empty surroundings do in ``response``
SCATTER_SIGMA = 0.3  # of the logarithm of the scatter factor
HEIGHT_SIGMA_M = 0.5  # of the source above the ground
MEAN_FACING = 0.565  # mean of f over all headings, the source 5 to 45 degrees below the horizon
_OTHER_PS = 0.2  # background of another origin than soil, as a share of that of ``response``


@dataclass(frozen=True, slots=True)
class SoilChannel:
    """One kind of event. near_mm2, steep_mm2, air_mm2: effective areas. turn: see above. background_ps: per second."""

    near_mm2: float
    steep_mm2: float
    air_mm2: float
    turn: float
    background_ps: float


class SoilTable:
    """The channels' table as arrays (C,), and the background per second over soil."""

    def __init__(self, channels: tuple[SoilChannel, ...], body_mm2: Array, alone_ps: Array) -> None:
        """body_mm2, alone_ps: (C,) areas for photons that vehicle and mount scatter, background without soil."""
        table = np.array([(c.near_mm2, c.steep_mm2, c.air_mm2, c.turn, c.background_ps) for c in channels]).T
        self._near, self._steep, self._air, self._turn, own_ps = table
        self._body_mm2 = body_mm2
        self.background_ps: Array = own_ps + _OTHER_PS * alone_ps

    def by_soil(self, fluence: Array, steepness: Array, facing: Array | float) -> Array:
        """Expected counts (..., C) of photons scattered by soil; arguments as of ``Response.parts``."""
        turned = 1.0 + self._turn * (np.asarray(facing)[..., None] - MEAN_FACING)
        mm2 = np.maximum(self._near + self._steep * steepness[..., None], 0.0) * turned
        result: Array = mm2 * fluence[..., None]
        return result

    def beside_soil(self, fluence: Array, depth: Array) -> Array:
        """Expected counts (..., C) of photons scattered by air, vehicle and mount. depth: (...) mu D."""
        result: Array = (self._air * depth[..., None] + self._body_mm2) * fluence[..., None]
        return result

    def steep_share(self, soil_share: Array, steepness: Array) -> Array:
        """Share (...) of all counts that grows in proportion to the steepness. soil_share: (...) of photons scattered by soil."""
        steep = self._steep.sum() * steepness
        result: Array = soil_share * steep / (self._near.sum() + steep)
        return result


def _soil(*rows: tuple[float, ...]) -> tuple[SoilChannel, SoilChannel]:
    """Partial- and full-energy events, of the rows of hits, full-energy events and coincidences: see ``Response.apart``."""
    hits, full, pairs = (np.array([*row[:3], row[3] * (row[0] + 0.5 * row[1]), row[4]]) for row in rows)
    partial = hits - full - pairs
    return _channel(partial), _channel(full)


def _channel(row: Array) -> SoilChannel:
    near, steep, air, turned, background_ps = row.tolist()
    return SoilChannel(near, steep, air, turned / (near + 0.5 * steep), background_ps)


# hits, full-energy events and coincidences: near, steep, air, turn (of the first two), background
SOIL: dict[str, tuple[SoilChannel, SoilChannel]] = {
    "Cs-137": _soil(
        (2.07, 50.4, 203.0, 0.55, 4.56),
        (0.0415, -0.0618, 1.12, 0.4, 0.0396),
        (0.453, 2.62, 9.09, 0.07, 0.186),
    ),
    "Co-60": _soil(
        (1.03, 40.9, 189.0, 0.53, 4.56),
        (0.00839, -0.0138, 0.432, 0.01, 0.0321),
        (0.264, 2.31, 8.18, 0.05, 0.186),
    ),
    "I-131": _soil(
        (5.39, 63.0, 242.0, 0.61, 4.56),
        (3.19, -2.05, 4.96, 0.21, 0.272),
        (0.821, 2.53, 9.69, 0.1, 0.186),
    ),
    "Ir-192": _soil(
        (4.47, 63.3, 248.0, 0.61, 4.56),
        (2.02, -1.46, 7.7, 0.2, 0.265),
        (0.66, 2.57, 10.3, 0.14, 0.186),
    ),
    "Na-22": _soil(
        (1.59, 50.0, 217.0, 0.55, 4.56),
        (0.511, -0.467, 1.5, 0.06, 0.0751),
        (0.472, 2.52, 9.19, 0.08, 0.186),
    ),
}
