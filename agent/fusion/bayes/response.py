"""The expected rates of a camera beside a source: hits, full-energy events, coincidences and cones, by nuclide.

With activity A = exp(a) REFERENCE_BQ at the distance D, the photons per mm2 and second that reach the camera unscattered are

    phi(D) = A n exp(-mu D) / (4 pi D^2) 1e-6,    n = ``photons_per_decay``, mu = ``air_per_m``,

and a channel of effective area F = ``area_mm2`` counts, per second, with build-up by scattered photons linear in the depth,

    S + B,    S = phi(D) F (direct + scattered mu D + edge (``_MEAN_EDGE`` - exp(-f / 0.2))),    B = ``background_ps``.

F is the mean over the heading. f is the cosine of the angle between the source and the normal of the sensor's face. A camera
with its edge towards the source counts 20 % fewer direct photons of Cs-137 than with its face. The figures come from this
project's own photon transport (sim/radiation) and detector chain, not from measurements.

Left out:

- two photons of one decay in the sensor at once (Co-60, Na-22 and others; probability of a second one about 1e-6 at a metre);
- the stronger attenuation of a nuclide's softer lines by air (one mu for all; the channels' rates fit within 1 % up to 35 m);
- the growth of cones of scattered photons with the distance (up to 35 m by 3 % of Cs-137's, 11 % of I-131's).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from radron.agent.errors import ConfigError
from radron.agent.fusion.bayes.soil import BODY_SHARE, SOIL, SoilChannel, SoilTable
from radron.agent.fusion.facing import MEAN_FACING
from radron.agent.geometry import Array

REFERENCE_BQ = 1e9  # unit of the activities
MIN_SOURCE_DISTANCE_M = 0.3  # least distance of a camera from a source in the model

_HITS_PER_EVENT = 1.05  # of the background: one of twenty of its photons is absorbed in two steps
_EDGE_FACING = 0.2  # f up to which the edge matters
_MEAN_EDGE = 0.154  # mean of exp(-f / 0.2) over all headings, the source 5 to 45 degrees below the horizon


def edge_factor(facing: Array) -> Array:
    """Return how much the orientation of the sensor changes the direct counts, relative to the mean over all headings.

    The result, mean - exp(-f / 0.2), is multiplied with the channel's coefficient ``edge``. facing: f of any shape, cosine of the
    angle between the sensor's normal and the direction to the source.
    """
    result: Array = _MEAN_EDGE - np.exp(facing * (-1.0 / _EDGE_FACING))
    return result


@dataclass(frozen=True, slots=True)
class Channel:
    """Constants of one kind of event that a camera counts, from which its expected rate beside a source follows.

    The rate is S + B with S = phi(D) F (direct + scattered mu D + edge ``edge_factor``(f)): phi(D) the flux of unscattered
    photons at the distance D, mu the attenuation by air, f the sensor's orientation. area_mm2: effective area F, mean over the
    heading. direct, scattered, edge: coefficients for direct photons, photons scattered by air, and the orientation.
    background_ps: background rate B, per second.
    """

    area_mm2: float
    direct: float
    scattered: float
    background_ps: float
    edge: float

    def less(self, other: Channel) -> Channel:
        """Return the constants of the events that are counted here but not in ``other``: rates are the differences of both."""
        area_mm2 = self.area_mm2 - other.area_mm2
        direct = self.area_mm2 * self.direct - other.area_mm2 * other.direct
        scattered = self.area_mm2 * self.scattered - other.area_mm2 * other.scattered
        edge = self.area_mm2 * self.edge - other.area_mm2 * other.edge
        background_ps = self.background_ps - other.background_ps
        return Channel(area_mm2, direct / area_mm2, scattered / area_mm2, background_ps, edge / area_mm2)


@dataclass(frozen=True)
class Response:
    """The expected counts of a camera beside a source of one nuclide, with the detection chain of radron.agent.detector by
    default settings.

    photons_per_decay: n, of all lines above 100 keV; air_per_m: attenuation coefficient mu of air, mean over these lines.
    channels:
    partial-energy events (less than a photon's energy), and full-energy events (near one of the nuclide's lines). cones: events
    that became a cone. soil: constants for scattered photons with the source on soil; None: nothing below the source. strength:
    of the background, relative to the tables.
    """

    nuclide: str
    photons_per_decay: float
    air_per_m: float
    channels: tuple[Channel, Channel]
    cones: Channel
    soil: tuple[SoilChannel, SoilChannel] | None = None
    strength: float = 1.0

    def with_background(self, per_s: float) -> Response:
        """Return the response with a measured background (events per second); all background rates are scaled in proportion."""
        return replace(self, strength=self.strength * per_s / (_HITS_PER_EVENT * float(self.background_ps.sum())))

    @staticmethod
    def apart(counts: Array) -> Array:
        """Return the numbers (2,) of partial-energy and full-energy events from the counts (3,) of an exposure.

        The counts of an exposure: hits h, full-energy events f, coincidences c (two hits of one photon). A full-energy event is
        one hit or one coincidence. So the partial-energy events are h - f - c, and every event is in exactly one channel. Only
        then are the channels independent Poisson variables. The variance of h alone is a quarter larger than its mean. If assumed
        independent, h, f and c would hold twice the actual information.
        """
        hits, photopeak, coincidences = counts.tolist()
        return np.array([max(hits - photopeak - coincidences, 0.0), photopeak])

    @cached_property
    def background_ps(self) -> Array:
        """Background rates (2,) of the camera, per second: partial-energy and full-energy events."""
        return self.strength * (self._alone_ps if self.over_soil is None else self.over_soil.background_ps)

    @property
    def _alone_ps(self) -> Array:
        return np.array([channel.background_ps for channel in self.channels])

    @cached_property
    def over_soil(self) -> SoilTable | None:
        """Table of scattered photons and background with the source on soil; None if nothing is assumed below the source."""
        if self.soil is None:
            return None
        area_mm2, direct, _, _ = self._terms  # a fixed share of ``direct`` stands for vehicle and mount alone
        return SoilTable(self.soil, BODY_SHARE * area_mm2 * (direct - 1.0), self._alone_ps)

    @cached_property
    def _terms(self) -> tuple[Array, Array, Array, Array]:
        """F, direct, scattered and edge of the channels, (2,) each."""
        area_mm2, direct, scattered, edge = np.array([(c.area_mm2, c.direct, c.scattered, c.edge) for c in self.channels]).T
        return area_mm2, direct, scattered, edge

    @property
    def cone_area_mm2(self) -> float:
        """Effective area (mm2) for cones, by which the flux phi(D) is multiplied to give the rate R of cones."""
        return self.cones.area_mm2 * self.cones.direct

    @property
    def cone_background_ps(self) -> float:
        """Rate of Compton cones that the camera measures without a source, per second."""
        return self.strength * self.cones.background_ps

    def flux(self, distance_m: Array) -> Array:
        """Return the flux phi(D) of unscattered photons, per mm2 and second, from a source of activity REFERENCE_BQ.

        distance_m: D > 0 of any shape, distance of the camera from the source.
        """
        per_mm2 = REFERENCE_BQ * self.photons_per_decay / (4e6 * np.pi)
        result: Array = per_mm2 * np.exp(-self.air_per_m * distance_m) / distance_m**2
        return result

    def signal(self, fluence: Array, distance_m: Array, steepness: Array | float = 0.0) -> Array:
        """Return the counts (..., 2) of partial-energy and full-energy events expected from a source, in the mean over the
        camera's heading.

        fluence: (...) unscattered photons per mm2: flux phi(D), times live time, times activity in units of REFERENCE_BQ.
        distance_m: (...) distance D. steepness: (...) sine of the source's depression below the horizon.
        """
        area_mm2, direct, scattered, _ = self._terms
        depth = self.air_per_m * distance_m
        if self.over_soil is not None:
            by_soil = self.over_soil.by_soil(fluence, np.asarray(steepness), MEAN_FACING)
            return area_mm2 * fluence[..., None] + (by_soil + self.over_soil.beside_soil(fluence, depth))
        result: Array = area_mm2 * (direct + scattered * depth[..., None]) * fluence[..., None]
        return result

    def parts(self, fluence: Array, distance_m: Array, facing: Array, by_soil: Array | None = None) -> tuple[Array, Array]:
        """Return the counts (..., 2) of partial-energy and full-energy events expected from direct photons, and from scattered
        photons.

        facing: (...) f, cosine of the angle between the sensor's normal and the direction to the source. by_soil: (..., 2) result
        of ``SoilTable.by_soil``, if the source is on soil. fluence, distance_m: as in ``signal``.
        """
        area_mm2, direct, scattered, edge = self._terms
        depth, unscattered = self.air_per_m * distance_m, area_mm2 * fluence[..., None]
        straight = (1.0 + edge * edge_factor(facing)[..., None]) * unscattered
        if self.over_soil is not None and by_soil is not None:
            return straight, by_soil + self.over_soil.beside_soil(fluence, depth)
        return straight, (direct - 1.0 + scattered * depth[..., None]) * unscattered


def _response(nuclide: str, photons_per_decay: float, air_per_m: float, *rows: tuple[float, ...]) -> Response:
    hits, photopeak, coincidences, cones = (Channel(*row) for row in rows)
    partial = hits.less(photopeak).less(coincidences)
    return Response(nuclide, photons_per_decay, air_per_m, (partial, photopeak), cones)


# From ``python -m benchmarks.channel_response --events 400000 Cs-137 Co-60 I-131 Ir-192 Na-22``: hits, photopeak, coincidences
# and cones (cones with --events 200000), each with area (mm2), direct, scattered, background (1/s), and edge.
RESPONSES: dict[str, Response] = {
    response.nuclide: response
    for response in (
        _response(
            "Cs-137",
            0.851,
            0.00929,
            (17.1, 1.20, 0.78, 1.56, 0.20),
            (2.68, 1.04, 0.12, 0.043, 0.27),
            (1.55, 1.23, 0.84, 0.0864, 0.08),
            (0.815, 1.04, 0.09, 0.00803, 0.21),
        ),
        _response(
            "Co-60",
            1.998,
            0.00685,
            (11.8, 1.20, 0.82, 1.57, 0.13),
            (2.13, 1.00, 0.12, 0.0164, 0.11),
            (0.877, 1.26, 1.11, 0.0872, -0.05),
            (0.483, 1.02, 0.06, 0.00384, 0.02),
        ),
        _response(
            "I-131",
            0.9655,
            0.01177,
            (29.7, 1.20, 0.63, 1.57, 0.40),
            (10.6, 1.11, 0.38, 0.182, 0.31),
            (2.83, 1.16, 0.60, 0.0887, 0.30),
            (2.18, 1.09, 0.30, 0.0270, 0.31),
        ),
        _response(
            "Ir-192",
            2.137,
            0.01202,
            (28.2, 1.19, 0.70, 1.56, 0.35),
            (12.6, 1.08, 0.29, 0.184, 0.35),
            (2.98, 1.15, 0.60, 0.0885, 0.32),
            (2.37, 1.08, 0.28, 0.0268, 0.34),
        ),
        _response(
            "Na-22",
            2.797,
            0.00911,
            (17.1, 1.20, 0.66, 1.56, 0.20),
            (4.03, 1.06, 0.17, 0.0588, 0.19),
            (1.58, 1.23, 0.69, 0.0825, 0.07),
            (0.960, 1.05, 0.13, 0.0144, 0.11),
        ),
    )
}


def response_of(nuclide: str, ground: str = "none") -> Response:
    """Return the response of a camera to a nuclide, with the source over soil or over nothing (``fusion.ground`` of the mission).

    Raises:
        ConfigError: the table lacks the nuclide.
    """
    try:
        response = RESPONSES[nuclide]
        return response if ground == "none" else replace(response, soil=SOIL[nuclide])
    except KeyError:
        raise ConfigError(
            f"nuclide {nuclide!r}: estimator 'bayes' does not know what a camera counts of it; it knows {', '.join(RESPONSES)}; "
            "estimator 'paper' needs no such knowledge"
        ) from None
