"""Vehicles that the others contradict: the innovation gate rejects their exposures again and again, and passes those of others.

Such a vehicle has a wrong position, as where its satellites are slowly spoofed, or a camera that counts wrongly. One exposure
that passes the gate by chance can then move the source by metres: of five vehicles one was spoofed by 8 m, passed close by the
source, and the track followed it for two seconds (``radron-sim faults --seed 1430388 --runs 1``). So what it measures is left
out, and only tested by the gate, until it has been rejected less for a while. That takes two others whose exposures pass:
between two vehicles nothing tells which of them is right. A source that leaps by more than a source is expected to can have the
camera that it passes rejected alone; that one is left out for a quarter of a minute then, and the others find the source again.

Cones have no gate. A cone that makes the source less likely, by a log Bayes factor of n, counts as n / ``CONE_NATS`` rejections;
a cone that makes it more likely takes as many back, down to none (a CUSUM test [Page 1954]). Cones of a camera that measures as
modelled reach ``MOST`` by chance with a probability of about e^-18 (``MOST * CONE_NATS``) in each run from none.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from agent.fusion.bayes.doubted import Sure, others

MOST = 3.0  # rejections: more than three in succession
CONE_NATS = 6.0  # log Bayes factor of cones that counts as one rejection
_REMEMBERED = 8.0  # at most: who is right again counts again half a minute later
_LEAST_OTHERS = 2
_TRUSTED = 1.0  # with fewer rejections
_FADE_NS = 30_000_000_000  # a circle takes 10 to 30 s, and seen from some sides a wrong position changes the counts little

Rejections = Mapping[int, tuple[float, int]]  # by vehicle, how many there were, faded, up to the newest, and its stamp


def rejected(rejections: Rejections, vehicle: int, stamp_ns: int, more: float = 1.0) -> Rejections:
    """``rejections`` with one more, of an exposure, or with ``more``, of a cone; negative: the cone points to the source."""
    _, newest_ns = rejections.get(vehicle, (0.0, stamp_ns))
    count = min(max(_faded(rejections, vehicle, stamp_ns) + more, 0.0), _REMEMBERED)
    return {**rejections, vehicle: (count, max(stamp_ns, newest_ns))}


def is_contradicted(rejections: Rejections, sure: Sure, vehicle: int, stamp_ns: int) -> bool:
    """Whether what a vehicle measures is not to count. ``sure``: see ``doubted``."""
    if _faded(rejections, vehicle, stamp_ns) < MOST:
        return False
    return sum(_faded(rejections, other, stamp_ns) < _TRUSTED for other in others(sure, vehicle, stamp_ns)) >= _LEAST_OTHERS


def is_disputed(sure: Sure, vehicle: int, stamp_ns: int) -> bool:
    """Whether one other vehicle alone measures what a rejected one contradicts: nothing tells which of them is right."""
    return len(others(sure, vehicle, stamp_ns)) == 1


def _faded(rejections: Rejections, vehicle: int, stamp_ns: int) -> float:
    """How many rejections there were, each faded by exp(-age / ``_FADE_NS``)."""
    count, newest_ns = rejections.get(vehicle, (0.0, stamp_ns))
    return count * math.exp(-max(stamp_ns - newest_ns, 0) / _FADE_NS)
