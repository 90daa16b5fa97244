"""Where one may be that is heard again, but whose localisation has jumped meanwhile, as long as nobody knows its frame.

By continuity it is where it was heard last, or a little further on (``localization.continuity``). If its agent was gone, its
vehicle may as well have been on its way home, or there, when the agent was started again; it waits there until it is placed.
That it may be silent once more meanwhile changes nothing: a vehicle that holds stays where it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import numpy as np

from agent.motion.separation import PeerPlan
from agent.navigation.unheard.agentless import Course
from agent.navigation.unheard.viewer import Viewer


class HeardAgain:
    """Those that are heard again: how long they had been silent then, in seconds, and what their vehicles may have done."""

    def __init__(self) -> None:
        self._ended: dict[str, tuple[float, Sequence[Course]]] = {}

    def follow(self, name: str, stamp_ns: int, silent: tuple[int, Sequence[Course]] | None, *, is_carried: bool) -> None:
        """Note for how long a drone was silent that is heard again and whose frame is one by continuity; else forget it.

        Args:
            name: its id.
            stamp_ns: of its newest pose.
            silent: since when it was silent, and its courses; None where it was heard before, too.
            is_carried: its frame is one by continuity.
        """
        if not is_carried:
            self.forget(name)
        elif silent is not None and any(course.way is not None for course in silent[1]):
            self._ended[name] = (stamp_ns - silent[0]) * 1e-9, silent[1]

    def forget(self, name: str) -> None:
        """Forget for how long a drone was silent: it is on the ground, or seen, or its frame is known."""
        self._ended.pop(name, None)

    def plans(self, name: str, me: Viewer) -> list[PeerPlan]:
        """Where it may be beside its place by continuity, as far as that is nearest to this drone's own plan."""
        silent_s, courses = self._ended.get(name, (0.0, ()))
        ahead = me.way()[:, :2]
        found = []
        for course in courses:
            times = np.full(len(ahead), min(silent_s, course.arrives_s))
            ways = (way for way in course.stretches(times, inf) if not course.is_stop(way))
            found += [me.expects(name, way.nearest(ahead)) for way in ways]
        return found
