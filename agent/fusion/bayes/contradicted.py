"""Vehicles that the others contradict: the innovation gate rejects their exposures again and again, and passes those of others.

Such a vehicle is not where it takes itself to be, as where its satellites are slowly spoofed, or its camera counts wrongly. One
exposure that passes the gate by chance can then move the source by metres: of five vehicles one was spoofed by 8 m, passed close
by the source, and took the track along for two seconds (``radron-sim faults --seed 1430388 --runs 1``). So what it measures is
left out, and only held against the gate, until it has been rejected less for a while. That takes two others that the gate passes:
between two vehicles nothing tells which of them is right; and where a source moves off, the gate rejects all alike.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from agent.fusion.bayes.doubted import RECENT_NS, Sure

MOST = 3.0  # rejections: more than three in succession
_REMEMBERED = 8.0  # at most: who is right again counts again half a minute later
_LEAST_OTHERS = 2
_TRUSTED = 1.0  # with fewer rejections
_FADE_NS = 30_000_000_000  # a circle takes 10 to 30 s, and from some sides a wrong place shows little

Rejections = Mapping[int, tuple[float, int]]  # by vehicle, how many there were, faded, up to the newest, and its stamp


def rejected(rejections: Rejections, vehicle: int, stamp_ns: int) -> Rejections:
    """``rejections``, with that of one more exposure."""
    _, newest_ns = rejections.get(vehicle, (0.0, stamp_ns))
    count = min(_faded(rejections, vehicle, stamp_ns) + 1.0, _REMEMBERED)
    return {**rejections, vehicle: (count, max(stamp_ns, newest_ns))}


def is_contradicted(rejections: Rejections, sure: Sure, vehicle: int, stamp_ns: int) -> bool:
    """Whether what a vehicle measures is not to count. ``sure``: when which vehicle measured last."""
    if _faded(rejections, vehicle, stamp_ns) < MOST:
        return False
    recent = (other for other, newest_ns in sure.items() if other != vehicle and stamp_ns - newest_ns <= RECENT_NS)
    return sum(_faded(rejections, other, stamp_ns) < _TRUSTED for other in recent) >= _LEAST_OTHERS


def _faded(rejections: Rejections, vehicle: int, stamp_ns: int) -> float:
    """How many rejections there were, each faded by exp(-age / ``_FADE_NS``)."""
    count, newest_ns = rejections.get(vehicle, (0.0, stamp_ns))
    return count * math.exp(-max(stamp_ns - newest_ns, 0) / _FADE_NS)
