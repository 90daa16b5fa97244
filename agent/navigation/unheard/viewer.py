"""The drone that keeps clear of others that are not heard, as that needs it."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np
from msgspec import Struct

from agent.frames.transform import Transform
from agent.geometry import Array
from agent.motion.reference import PeerState
from agent.motion.separation import PeerPlan
from agent.navigation.peers.placing import blind_plan
from agent.navigation.unheard.contact import Circle, Wall

_BEHIND_M = 2.0  # nearest place of the other beyond the line half-way: with margins, each stays 3.6 m from it


class Viewer(Struct, frozen=True):
    """Its frame, its planned positions (K, 3) from now on, ``step_s`` apart, local frame of this ``epoch``, and how it moved at a
    stamp, mission frame. ``circle``: None where it does not track. ``height_m``: above ground; ``returning_s``: since it began to
    return, None where it does not; ``revoked``: nobody hears it, as all know, and it returns; ``excluded``: the others of which
    this holds.
    """

    now_ns: int
    epoch: int
    step_s: float
    local_from_mission: Transform
    ahead: Callable[[], Array]
    motion_at: Callable[[int], PeerState | None]
    circle: Circle | None
    height_m: float
    returning_s: float | None
    revoked: bool = False
    excluded: Collection[str] = ()

    def way(self) -> Array:
        """Its planned positions (K, 3), mission frame."""
        return self.local_from_mission.inverse().apply(self.ahead())

    def local(self, places: Array) -> Array:
        """Places (K, 3) of places (K, 2) of the mission frame in its own."""
        return self.local_from_mission.apply(np.column_stack((places, np.zeros(len(places)))))

    def expects(self, name: str, places: Array, sigma_m: float = 0.0) -> PeerPlan:
        """One that may be at places (K, 2) of the mission frame at these times, and does not know of this drone."""
        return blind_plan(name, self.now_ns, self.step_s, self.local(places), sigma_m)

    def beyond(self, name: str, wall: Wall, sigma_m: float) -> PeerPlan:
        """One that may be anywhere beyond a line, where that is nearest to the own plan."""
        normal, ahead = np.array(wall.normal), self.way()[:, :2]
        places = ahead - (ahead @ normal - (wall.offset - _BEHIND_M))[:, None] * normal
        u, v, _ = self.local_from_mission.rotate_direction((*wall.normal, 0.0))
        return blind_plan(name, self.now_ns, self.step_s, self.local(places), sigma_m, away=np.tile((u, v), (len(places), 1)))

    def in_mission(self, local: PeerState) -> PeerState:
        """A motion in its own frame in the mission frame."""
        to_mission = self.local_from_mission.inverse()
        return PeerState(to_mission.apply_point(local.position), to_mission.rotate_direction(local.velocity), local.age_s)
