"""Drones that fly near a drone on the ground, which must not take off close to them.

Before it is armed, they do not know of it, and they need some seconds to make room for a climbing drone.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import hypot

from radron.agent.geometry import Vector3
from radron.agent.motion.separation import DOUBT_SIGMAS
from radron.agent.navigation.neighbours import Neighbour
from radron.agent.navigation.peers.newest import Peers
from radron.protocol.messages import Stage
from radron.protocol.stages import DESCENDING

_AHEAD_S = 2.0  # from the command to the lift-off
_MARGIN_M = 1.0  # added to the separation
_MOST_DOUBT_M = 2.0  # limit of the distance added for position uncertainty: else a drone with an uncertain frame never takes off
_CLOSE = 0.8  # share of the separation kept from a landing drone: it stays over its place, and others stand right beside it


def passing(position_m: Vector3, others: Iterable[Neighbour], peers: Peers, separation_m: float) -> tuple[str, ...]:
    """Return the ids of the drones in ``others`` that are too near to a position (m, in their frame) for a takeoff there, or will
    be so within two seconds. Drones that take off themselves do not count.
    """
    found = []
    for other in others:
        stage, state = peers[other.id].stage, other.plan.measured
        if state is None or stage is Stage.TAKEOFF:
            continue
        doubt_m = other.plan.doubt_m + min(DOUBT_SIGMAS * other.plan.sigma_m, _MOST_DOUBT_M)
        keep_m = _CLOSE * separation_m if stage in DESCENDING else separation_m + _MARGIN_M + doubt_m
        (x, y, _), (u, v, _) = state.position, state.velocity
        away_x, away_y = x + state.age_s * u - position_m[0], y + state.age_s * v - position_m[1]
        nearest_s = min(max(-(away_x * u + away_y * v) / max(u * u + v * v, 1e-9), 0.0), _AHEAD_S)
        if hypot(away_x + nearest_s * u, away_y + nearest_s * v) < keep_m:
            found.append(other.id)
    return tuple(found)
