"""Further possible positions of a peer that is heard again after a lost link, and whose localisation has jumped meanwhile.

Its frame after the jump is not in the log yet. If the vehicle has not moved, the peer is at its last known position, or a little
ahead (``localization.continuity``). But if its agent was lost and started again, the vehicle may have been on its way home then,
or there. It waits there until its frame is known, also if the link is lost again.
"""

from __future__ import annotations

from math import inf

import numpy as np

from radron.agent.motion.separation import PeerPlan
from radron.agent.navigation.others.belief import PeerBelief
from radron.agent.navigation.unheard.viewer import Viewer


def follow(belief: PeerBelief, heard_ns: int, *, is_carried: bool) -> None:
    """Note the silence of a peer that is heard again, if it may have returned meanwhile; forget it once its frame is in the log.

    Args:
        belief: knowledge about the peer; changed here.
        heard_ns: stamp of its newest pose.
        is_carried: its frame assumes that the vehicle did not jump with its localisation; the log has no frame of it yet.
    """
    if not is_carried:
        belief.silence = None
    elif belief.courses is not None and any(course.way is not None for course in belief.courses):
        belief.silence = (heard_ns - belief.courses_ns) * 1e-9, belief.courses


def further_plans(belief: PeerBelief, name: str, me: Viewer) -> list[PeerPlan]:
    """Return, as obstacles, the places on the way home or over home where the peer may be; empty without such a silence.

    Each obstacle is the point of the way nearest to this drone's plan.
    """
    silent_s, courses = belief.silence or (0.0, ())
    ahead = me.way()[:, :2]
    found = []
    for course in courses:
        times = np.full(len(ahead), min(silent_s, course.arrives_s))
        ways = (way for way in course.stretches(times, inf) if not course.is_stop(way))
        found += [me.expects(name, way.nearest(ahead)) for way in ways]
    return found
