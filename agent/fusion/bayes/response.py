"""The expected rates of a camera beside a source: hits, full-energy events, coincidences and cones, by nuclide.

With activity A = exp(a) REFERENCE_BQ at the distance D, the photons per mm2 and second that reach the camera unscattered are

    phi(D) = A n exp(-mu D) / (4 pi D^2) 1e-6,    n = ``photons_per_decay``, mu = ``air_per_m``,

and a channel of effective area F = ``area_mm2`` counts, per second, with build-up by scattered photons linear in the depth,

    S + B,    S = phi(D) F (direct + scattered mu D),    B = ``background_ps``.

Effective areas are means over the heading and nearly isotropic, so the camera's attitude does not enter: with the sensor's edge
towards the source hits are 14 % fewer for Cs-137, 11 % for Co-60, 29 % for I-131, 26 % for Ir-192. The figures come from this
project's own photon transport (sim/radiation) and detector chain, not from measurements.

Left out: two photons of one decay in the sensor at once (Co-60, Na-22 and others; a second one meets it with a probability of
about 1e-6 at a metre); that air attenuates a nuclide's softer lines more (one mu for all; the channels' rates fit
within 1 % up to 35 m); that cones of scattered photons grow with the distance (up to 35 m by 3 % of Cs-137's, 11 % of I-131's).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from agent.errors import ConfigError
from agent.geometry import Array

REFERENCE_BQ = 1e9  # unit of the activities
NEAREST_M = 0.3  # least distance of a camera from a source in the model


@dataclass(frozen=True, slots=True)
class Channel:
    """One kind of event. area_mm2: F, effective area. direct, scattered: the coefficients of S. background_ps: B."""

    area_mm2: float
    direct: float
    scattered: float
    background_ps: float

    def less(self, other: Channel) -> Channel:
        """The channel of the events that are counted here and not in ``other``: its S and B are the differences."""
        area_mm2 = self.area_mm2 - other.area_mm2
        direct = self.area_mm2 * self.direct - other.area_mm2 * other.direct
        scattered = self.area_mm2 * self.scattered - other.area_mm2 * other.scattered
        return Channel(area_mm2, direct / area_mm2, scattered / area_mm2, self.background_ps - other.background_ps)


@dataclass(frozen=True)
class Response:
    """The rates of one nuclide in the detector chain of agent.detector with its default configuration.

    photons_per_decay: n, of all lines above 100 keV; air_per_m: mu, the mean of their attenuations. channels: partial-energy
    events (less than a photon's energy), and full-energy events (in the window of any of the nuclide's lines). cones: events
    that became a cone.
    """

    nuclide: str
    photons_per_decay: float
    air_per_m: float
    channels: tuple[Channel, Channel]
    cones: Channel

    @staticmethod
    def apart(counts: Array) -> Array:
        """Counts (2,) by channel, partial- and full-energy events, from the counts (3,) of an exposure: hits h, full-energy
        events f, coincidences c.

        A full-energy event is one hit or one coincidence, and a coincidence is two hits; so the partial-energy events are
        h - f - c, and every event is in exactly one channel. Only then are the channels independent Poisson variables: the
        variance of h alone is a quarter larger than its mean, and h, f and c taken as independent would hold twice the
        information that there is.
        """
        hits, photopeak, coincidences = counts.tolist()
        return np.array([max(hits - photopeak - coincidences, 0.0), photopeak])

    @cached_property
    def background_ps(self) -> Array:
        """(2,) B of the channels, per second."""
        return np.array([channel.background_ps for channel in self.channels])

    @cached_property
    def _terms(self) -> tuple[Array, Array, Array]:
        """F, direct and scattered of the channels, (2,) each."""
        area_mm2, direct, scattered = np.array([(c.area_mm2, c.direct, c.scattered) for c in self.channels]).T
        return area_mm2, direct, scattered

    @property
    def cone_area_mm2(self) -> float:
        """Effective area for cones: F direct of ``cones``; R = phi(D) times this."""
        return self.cones.area_mm2 * self.cones.direct

    @property
    def cone_background_ps(self) -> float:
        """Background cones per second."""
        return self.cones.background_ps

    def flux(self, distance_m: Array) -> Array:
        """phi(D) for an activity of REFERENCE_BQ, per mm2 and second; distance_m: D > 0 of any shape."""
        per_mm2 = REFERENCE_BQ * self.photons_per_decay / (4e6 * np.pi)
        result: Array = per_mm2 * np.exp(-self.air_per_m * distance_m) / distance_m**2
        return result

    def signal(self, fluence: Array, distance_m: Array) -> Array:
        """Expected counts (..., 2) of the channels, S times the exposure.

        fluence: (...) phi(D) times live time and exp(a), photons per mm2. distance_m: (...) D.
        """
        area_mm2, direct, scattered = self._terms
        depth = self.air_per_m * distance_m
        result: Array = area_mm2 * (direct + scattered * depth[..., None]) * fluence[..., None]
        return result

    def direct(self, fluence: Array) -> Array:
        """The part (..., 2) of ``signal`` by photons straight from the source: F times the fluence."""
        result: Array = self._terms[0] * fluence[..., None]
        return result


def _response(nuclide: str, photons_per_decay: float, air_per_m: float, *rows: tuple[float, float, float, float]) -> Response:
    hits, photopeak, coincidences, cones = (Channel(*row) for row in rows)
    partial = hits.less(photopeak).less(coincidences)
    return Response(nuclide, photons_per_decay, air_per_m, (partial, photopeak), cones)


# From ``python -m benchmarks.channel_response --events 400000 Cs-137 Co-60 I-131 Ir-192 Na-22``: hits, photopeak, coincidences
# and cones (those with --events 200000), each with area (mm2), direct, scattered, and background (1/s).
RESPONSES: dict[str, Response] = {
    response.nuclide: response
    for response in (
        _response(
            "Cs-137",
            0.851,
            0.00929,
            (17.1, 1.20, 0.78, 1.56),
            (2.68, 1.04, 0.12, 0.043),
            (1.55, 1.23, 0.84, 0.0864),
            (0.815, 1.04, 0.09, 0.00803),
        ),
        _response(
            "Co-60",
            1.998,
            0.00685,
            (11.8, 1.20, 0.82, 1.57),
            (2.13, 1.00, 0.12, 0.0164),
            (0.877, 1.26, 1.11, 0.0872),
            (0.483, 1.02, 0.06, 0.00384),
        ),
        _response(
            "I-131",
            0.9655,
            0.01177,
            (29.7, 1.20, 0.63, 1.57),
            (10.6, 1.11, 0.38, 0.182),
            (2.83, 1.16, 0.60, 0.0887),
            (2.18, 1.09, 0.30, 0.0270),
        ),
        _response(
            "Ir-192",
            2.137,
            0.01202,
            (28.2, 1.19, 0.70, 1.56),
            (12.6, 1.08, 0.29, 0.184),
            (2.98, 1.15, 0.60, 0.0885),
            (2.37, 1.08, 0.28, 0.0268),
        ),
        _response(
            "Na-22",
            2.797,
            0.00911,
            (17.1, 1.20, 0.66, 1.56),
            (4.03, 1.06, 0.17, 0.0588),
            (1.58, 1.23, 0.69, 0.0825),
            (0.960, 1.05, 0.13, 0.0144),
        ),
    )
}


def response_of(nuclide: str) -> Response:
    """The response to the nuclide of that name.

    Raises:
        ConfigError: the table has none.
    """
    try:
        return RESPONSES[nuclide]
    except KeyError:
        raise ConfigError(
            f"nuclide {nuclide!r}: estimator 'bayes' does not know what a camera counts of it; it knows {', '.join(RESPONSES)}; "
            "estimator 'paper' needs no such knowledge"
        ) from None
