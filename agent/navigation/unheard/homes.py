"""Keep-out discs over the homes of missing drones, which may descend there at any time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from radron.agent.config.mission import MissionConfig
from radron.agent.geometry import Point2, Vector3
from radron.agent.motion.separation import PeerPlan
from radron.agent.navigation.others.belief import PeerBelief
from radron.agent.navigation.unheard.agentless import Course
from radron.agent.navigation.unheard.crossing import is_over_m
from radron.agent.navigation.unheard.viewer import Viewer
from radron.agent.navigation.unheard.wayaround import KeptPlace

# A missing drone that continues the mission returns when this drone does. This long after the begin of this drone's return it has
# descended over its home. In a descent through the lower layers, altitude layers separate nobody. A longer time would close rows
# of homes to all traffic.
# If this drone is revoked, the other drones return later, at any time. Then it keeps clear of their homes until it has landed;
# while it is above all low flight, it does so no longer than any other drone.
COMING_DOWN_S = 45.0


class Homes:
    """Present keep-out discs over the homes of other drones."""

    def __init__(self, mission: MissionConfig, drone: str, beliefs: Mapping[str, PeerBelief]) -> None:
        """``drone``: the own id; ``beliefs``: knowledge about each other drone, by id; the discs are stored there."""
        self._beliefs = beliefs
        self._is_over_m, self._separation_m = is_over_m(mission, drone), mission.limits.separation_m

    @property
    def kept(self) -> tuple[KeptPlace, ...]:
        """Keep-out discs over the homes of all drones; mission frame."""
        return tuple(home for _, belief in sorted(self._beliefs.items()) for home in belief.kept.values())

    def keep(self, name: str, home: Point2, sigma_m: float = 0.0) -> None:
        """Add the home of the drone ``name`` as a keep-out disc; ``home``: mission frame; ``sigma_m``: its 1 sigma, m."""
        self._beliefs[name].kept[home] = KeptPlace(home, sigma_m)

    def over(self, name: str, home: Vector3, me: Viewer) -> PeerPlan:
        """Add the home as a keep-out disc, and return the obstacle of a drone that stands there at any height."""
        self.keep(name, home[:2])
        return me.expects(name, np.tile(home[:2], (len(me.ahead()), 1)))

    def coming_down(self, name: str, home: Vector3, me: Viewer, returns: Sequence[tuple[int, Course]]) -> list[PeerPlan]:
        """Return, as an obstacle, a missing drone that may descend over its home while this drone returns; else an empty list.

        ``returns``: its possible returns, each with the stamp of its begin.
        """
        crosses = me.height_m > self._is_over_m
        if me.returning_s is None or (me.returning_s >= COMING_DOWN_S and (crosses or not me.revoked)):
            return []
        above_m = me.way()[:, 2] - self._separation_m
        if not any(course.is_over_home(me.times_since(since_ns), above_m) for since_ns, course in returns):
            return []
        return [self.over(name, home, me)]
