"""Directions in which a drone sees others, so that a drone whose frame is unknown can still move away from them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import atan2, pi

from radron.agent.motion.encirclement import wrapped
from radron.agent.navigation.peers.newest import Peers
from radron.agent.navigation.peers.sources import RECENT_NS
from radron.protocol.entries import Sighting


def seen_bearings(peers: Peers, epoch: int, now_ns: int) -> list[float]:
    """Return the horizontal directions (rad, ascending) in which this drone has seen others in the last 3 s; one for each drone
    seen, own local frame of this epoch.
    """
    found = (_usual(_bearings(peers[name].sightings, epoch, now_ns)) for name in peers.names)
    return sorted(bearing for bearing in found if bearing is not None)


def freest_bearing(seen: Sequence[float]) -> float:
    """Return the direction (rad) in the middle of the widest gap between the directions ``seen`` (rad, ascending); pi if there
    are none.
    """
    if not seen:
        return pi
    width, first = max((after - before, before) for before, after in pairwise((*seen, seen[0] + 2.0 * pi)))
    return wrapped(first + 0.5 * width)


def _bearings(sightings: Sequence[Sighting], epoch: int, now_ns: int) -> list[float]:
    recent = (one for one in sightings if one.epoch == epoch and now_ns - one.stamp_ns <= RECENT_NS)
    return [atan2(one.direction[1], one.direction[0]) for one in recent if one.direction is not None]


def _usual(bearings: Sequence[float]) -> float | None:
    """Return the median-like direction of several (rad): that with the least sum of angles to the others. A few directions may be
    of other objects. None without directions.
    """
    return min(bearings, key=lambda one: sum(abs(wrapped(one - other)) for other in bearings), default=None)
