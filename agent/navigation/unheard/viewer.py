"""State of this drone that the rules for lost peers need."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np
from msgspec import Struct

from radron.agent.frames.transform import Transform
from radron.agent.geometry import Array
from radron.agent.motion.reference import PeerState
from radron.agent.motion.separation import PeerPlan
from radron.agent.navigation.peers.placing import blind_plan
from radron.agent.navigation.unheard.contact import Circle, Wall

_BEHIND_M = 2.0  # nearest position of the peer beyond the line: with margins, each stays 3.6 m from the line


class Viewer(Struct, frozen=True):
    """Own frame, planned positions (K, 3) from now on, ``step_s`` apart, local frame of this ``epoch``, and the motion at a
    stamp, mission frame. ``circle``: None outside of tracking. ``height_m``: above ground; ``returning_s``: since the begin of
    the return, None without a return; ``revoked``: no drone hears this one, as all know, and it returns; ``excluded``: the other
    revoked drones.
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
        """Return the planned positions (K, 3), mission frame."""
        return self.local_from_mission.inverse().apply(self.ahead())

    def times_since(self, stamp_ns: int) -> Array:
        """Return the times (K,) of the planned positions since a stamp, s."""
        times: Array = (self.now_ns - stamp_ns) * 1e-9 + self.step_s * np.arange(float(len(self.ahead())))
        return times

    def local(self, places: Array) -> Array:
        """Return positions (K, 3), own local frame, of positions (K, 2), mission frame."""
        return self.local_from_mission.apply(np.column_stack((places, np.zeros(len(places)))))

    def expects(self, name: str, places: Array, sigma_m: float = 0.0) -> PeerPlan:
        """Return the plan of a non-cooperative peer at positions (K, 2) of the mission frame, one for each step."""
        return blind_plan(name, self.now_ns, self.step_s, self.local(places), sigma_m)

    def beyond(self, name: str, wall: Wall, sigma_m: float) -> PeerPlan:
        """Return the plan of a peer anywhere beyond a separation line, nearest to the own plan."""
        normal, ahead = np.array(wall.normal), self.way()[:, :2]
        places = ahead - (ahead @ normal - (wall.offset - _BEHIND_M))[:, None] * normal
        u, v, _ = self.local_from_mission.rotate_direction((*wall.normal, 0.0))
        return blind_plan(name, self.now_ns, self.step_s, self.local(places), sigma_m, away=np.tile((u, v), (len(places), 1)))

    def in_mission(self, local: PeerState) -> PeerState:
        """Return a motion, own local frame, in the mission frame."""
        to_mission = self.local_from_mission.inverse()
        return PeerState(to_mission.apply_point(local.position), to_mission.rotate_direction(local.velocity), local.age_s)
