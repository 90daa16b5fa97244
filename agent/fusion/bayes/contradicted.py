"""Contradicted vehicles: the innovation gate rejects their exposures again and again, and accepts the other vehicles'.

Such a vehicle has a wrong position, for example by slow spoofing of its satellites, or a camera with wrong counts. One exposure
that passes the gate by chance can then move the source by metres (docs/faults-found.md). So the vehicle's measurements are left
out, and only tested by the gate, until their rejections have faded. This requires two other vehicles whose exposures pass: a
conflict between two vehicles alone is undecidable. A source that leaps farther than expected can have the camera that it passes
rejected alone. In this case the camera is left out for a quarter of a minute, and the others find the source again.

Cones have no gate. A cone that makes the source less likely, by a log Bayes factor of n, counts as n / ``CONE_NATS`` rejections.
A cone that makes the source more likely removes as many, down to none (a CUSUM test [Page 1954]). Cones of a camera that measures
as modelled reach ``MAX_REJECTIONS`` by chance with a probability of about e^-18 (``MAX_REJECTIONS * CONE_NATS``) in each run from
none."""

from __future__ import annotations

import math
from collections.abc import Mapping

from radron.agent.fusion.bayes.doubted import Sure, others

MAX_REJECTIONS = 3.0  # rejections: more than three in succession
CONE_NATS = 6.0  # log Bayes factor of cones that counts as one rejection
_REMEMBERED = 8.0  # limit: a correct vehicle counts again half a minute later
_MIN_OTHERS = 2
_TRUSTED = 1.0  # with fewer rejections
_FADE_NS = 30_000_000_000  # a circle takes 10 to 30 s, and from some sides a wrong position changes the counts little

Rejections = Mapping[int, tuple[float, int]]  # by vehicle: faded number of rejections up to the newest, and its stamp


def rejected(rejections: Rejections, vehicle: int, stamp_ns: int, more: float = 1.0) -> Rejections:
    """Count one more measurement of a vehicle that does not fit the track of the source, and return the new counts by vehicle.

    more: 1 for an exposure that was rejected; for a cone its weight, negative if the cone points to the source. Counts fade with
    time.
    """
    _, newest_ns = rejections.get(vehicle, (0.0, stamp_ns))
    count = min(max(_faded(rejections, vehicle, stamp_ns) + more, 0.0), _REMEMBERED)
    return {**rejections, vehicle: (count, max(stamp_ns, newest_ns))}


def is_contradicted(rejections: Rejections, sure: Sure, vehicle: int, stamp_ns: int) -> bool:
    """Return whether a vehicle's measurements must be left out, since they were rejected often while other vehicles' were
    accepted.

    sure: times of observations at known positions, see ``doubted``.
    """
    if _faded(rejections, vehicle, stamp_ns) < MAX_REJECTIONS:
        return False
    return sum(_faded(rejections, other, stamp_ns) < _TRUSTED for other in others(sure, vehicle, stamp_ns)) >= _MIN_OTHERS


def is_disputed(sure: Sure, vehicle: int, stamp_ns: int) -> bool:
    """Return whether a rejected vehicle is contradicted by only one other vehicle, so that the faulty one is not known."""
    return len(others(sure, vehicle, stamp_ns)) == 1


def _faded(rejections: Rejections, vehicle: int, stamp_ns: int) -> float:
    """Return the number of rejections, each faded by exp(-age / ``_FADE_NS``)."""
    count, newest_ns = rejections.get(vehicle, (0.0, stamp_ns))
    return count * math.exp(-max(stamp_ns - newest_ns, 0) / _FADE_NS)
