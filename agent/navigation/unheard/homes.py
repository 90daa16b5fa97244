"""The homes of drones that are not heard, over which they may come down at any time."""

from __future__ import annotations

import numpy as np

from agent.config.mission import MissionConfig
from agent.geometry import Point2, Vector3
from agent.motion.separation import PeerPlan
from agent.navigation.unheard.agentless import Agentless
from agent.navigation.unheard.crossing import is_over_m
from agent.navigation.unheard.viewer import Viewer
from agent.navigation.unheard.wayaround import KeptPlace

# Who is not heard and flies on returns when this drone does, as its mission is the same. This long after that it has come down
# over its home, through the layers of those that return lower; who comes down itself may meet it there whatever the layers. Kept
# clear of for longer, homes in rows would let nobody past. Of one that is revoked the others return later, at any time: until it
# is down itself it keeps clear of their homes, which its own is apart from; while it crosses, for no longer than others.
COMING_DOWN_S = 45.0


class Homes:
    """Those that are kept clear of at present, by drone."""

    def __init__(self, mission: MissionConfig, drone: str, agentless: Agentless) -> None:
        """``drone``: the own id."""
        self._id, self._agentless = drone, agentless
        self._is_over_m = is_over_m(mission, drone)
        self._kept: dict[str, dict[Point2, KeptPlace]] = {}

    @property
    def kept(self) -> tuple[KeptPlace, ...]:
        """All of them; mission frame."""
        return tuple(home for _, homes in sorted(self._kept.items()) for home in homes.values())

    def forget(self, name: str) -> None:
        """Keep clear of the home of a drone no longer."""
        self._kept.pop(name, None)

    def keep(self, name: str, home: Point2, sigma_m: float = 0.0) -> None:
        """It may come down there."""
        self._kept.setdefault(name, {})[home] = KeptPlace(home, sigma_m)

    def over(self, name: str, home: Vector3, me: Viewer) -> PeerPlan:
        """It may be over its home, at whatever height."""
        self.keep(name, home[:2])
        return me.expects(name, np.tile(home[:2], (len(me.ahead()), 1)))

    def coming_down(self, name: str, home: Vector3, me: Viewer) -> list[PeerPlan]:
        """Over its home while this drone returns, too, if that is low, or in a lower layer."""
        crosses = me.height_m > self._is_over_m
        if me.returning_s is None or (me.returning_s >= COMING_DOWN_S and (crosses or not me.revoked)):
            return []
        if crosses and not self._agentless.returns_above(name, self._id):
            return []
        return [self.over(name, home, me)]
