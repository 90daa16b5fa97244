"""State of this drone, as the rules for missing drones need it."""

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

_BEHIND_M = 2.0  # a peer is assumed at least so far beyond the line: with 5 m between plans, each plan stays 3 m before its line


class Viewer(Struct, frozen=True):
    """State of this drone, in its local frame of this ``epoch``.

    ahead: returns the planned positions (K, 3) from now on, ``step_s`` apart, local frame.
    motion_at: returns position and velocity at a stamp, mission frame; None if this drone did not take part then.
    circle: its circle around the source; None outside of tracking.
    height_m: above ground. returning_s: time since the begin of its return; None if it does not return.
    revoked: it is revoked: no drone accepts its messages, and it returns. excluded: ids of the other revoked drones.
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
        """Return the planned positions (K, 3) of this drone from now on, in the mission frame."""
        return self.local_from_mission.inverse().apply(self.ahead())

    def times_since(self, stamp_ns: int) -> Array:
        """Return the times (K,), in s after a stamp, at which this drone is at its planned positions."""
        times: Array = (self.now_ns - stamp_ns) * 1e-9 + self.step_s * np.arange(float(len(self.ahead())))
        return times

    def local(self, places: Array) -> Array:
        """Convert horizontal positions (K, 2), mission frame, to positions (K, 3) in the own local frame, at height 0 of the
        mission frame.
        """
        return self.local_from_mission.apply(np.column_stack((places, np.zeros(len(places)))))

    def expects(self, name: str, places: Array, sigma_m: float = 0.0) -> PeerPlan:
        """Return the obstacle of a drone that gives no way, at positions (K, 2), mission frame, one for each step of the plan."""
        return blind_plan(name, self.now_ns, self.step_s, self.local(places), sigma_m)

    def beyond(self, name: str, wall: Wall, sigma_m: float) -> PeerPlan:
        """Return the obstacle of a drone anywhere on the other side of a separation line, at least 2 m beyond it."""
        normal, ahead = np.array(wall.normal), self.way()[:, :2]
        places = ahead - (ahead @ normal - (wall.offset - _BEHIND_M))[:, None] * normal
        u, v, _ = self.local_from_mission.rotate_direction((*wall.normal, 0.0))
        return blind_plan(name, self.now_ns, self.step_s, self.local(places), sigma_m, away=np.tile((u, v), (len(places), 1)))

    def in_mission(self, local: PeerState) -> PeerState:
        """Convert a position and velocity from the own local frame to the mission frame."""
        to_mission = self.local_from_mission.inverse()
        return PeerState(to_mission.apply_point(local.position), to_mission.rotate_direction(local.velocity), local.age_s)
