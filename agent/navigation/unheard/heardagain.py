"""Possible positions of a peer with a new link and a jump of its localisation meanwhile, until its frame is known.

By continuity the peer is at its last known position, or a little ahead (``localization.continuity``). After a loss of its agent,
the vehicle may as well have been on its way home, or there, at the restart of the agent. There it waits until it is placed. A new
loss of the link meanwhile changes nothing: a vehicle in hold stays.
"""

from __future__ import annotations

from math import inf

import numpy as np

from radron.agent.motion.separation import PeerPlan
from radron.agent.navigation.others.belief import PeerBelief
from radron.agent.navigation.unheard.viewer import Viewer


def follow(belief: PeerBelief, heard_ns: int, *, is_carried: bool) -> None:
    """Note the silence of a peer with a new link and a frame by continuity only; else forget it.

    Args:
        belief: knowledge about it, as before the new link.
        heard_ns: stamp of its newest pose.
        is_carried: its frame is known by continuity only.
    """
    if not is_carried:
        belief.silence = None
    elif belief.courses is not None and any(course.way is not None for course in belief.courses):
        belief.silence = (heard_ns - belief.courses_ns) * 1e-9, belief.courses


def further_plans(belief: PeerBelief, name: str, me: Viewer) -> list[PeerPlan]:
    """Return the possible positions beside the one by continuity, each nearest to this drone's own plan."""
    silent_s, courses = belief.silence or (0.0, ())
    ahead = me.way()[:, :2]
    found = []
    for course in courses:
        times = np.full(len(ahead), min(silent_s, course.arrives_s))
        ways = (way for way in course.stretches(times, inf) if not course.is_stop(way))
        found += [me.expects(name, way.nearest(ahead)) for way in ways]
    return found
