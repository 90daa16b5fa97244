"""Possible positions of a peer with a new link and a jump of its localisation meanwhile, until its frame is known.

By continuity the peer is at its last known position, or a little ahead (``localization.continuity``). After a loss of its agent,
the vehicle may as well have been on its way home, or there, at the restart of the agent. There it waits until it is placed. A new
loss of the link meanwhile changes nothing: a vehicle in hold stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import numpy as np

from radron.agent.motion.separation import PeerPlan
from radron.agent.navigation.unheard.agentless import Course
from radron.agent.navigation.unheard.viewer import Viewer


class HeardAgain:
    """Peers with a new link: the length of their silence, in seconds, and the possible failsafe courses of their vehicles."""

    def __init__(self) -> None:
        self._ended: dict[str, tuple[float, Sequence[Course]]] = {}

    def follow(self, name: str, stamp_ns: int, silent: tuple[int, Sequence[Course]] | None, *, is_carried: bool) -> None:
        """Note the silence of a peer with a new link and a frame by continuity only; else forget it.

        Args:
            name: its id.
            stamp_ns: of its newest pose.
            silent: begin of its silence, and its failsafe courses; None if it was heard before, too.
            is_carried: its frame is known by continuity only.
        """
        if not is_carried:
            self.forget(name)
        elif silent is not None and any(course.way is not None for course in silent[1]):
            self._ended[name] = (stamp_ns - silent[0]) * 1e-9, silent[1]

    def forget(self, name: str) -> None:
        """Forget the silence of a drone: it is on the ground, or seen, or its frame is known."""
        self._ended.pop(name, None)

    def plans(self, name: str, me: Viewer) -> list[PeerPlan]:
        """Return the possible positions beside the one by continuity, each nearest to this drone's own plan."""
        silent_s, courses = self._ended.get(name, (0.0, ()))
        ahead = me.way()[:, :2]
        found = []
        for course in courses:
            times = np.full(len(ahead), min(silent_s, course.arrives_s))
            ways = (way for way in course.stretches(times, inf) if not course.is_stop(way))
            found += [me.expects(name, way.nearest(ahead)) for way in ways]
        return found
