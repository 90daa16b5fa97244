"""State of this drone, as the prediction of the other drones needs it."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from radron.agent.frames.transform import Transform
from radron.agent.geometry import Array
from radron.agent.motion.reference import PeerState
from radron.agent.navigation.peers.placing import bare, unexplained_m
from radron.agent.navigation.unheard.contact import Circle
from radron.agent.navigation.unheard.viewer import Viewer

# This long after the begin of its return, a revoked drone ignores its alternative position hypothesis. Otherwise homes of other
# drones, as seen from there, could keep it from its own home for longer than the others expect it to be in flight.
PATIENT_S = 20.0


def _nowhere_ahead() -> Array:
    return np.zeros((1, 3))


def _no_motion(_: int) -> None:
    """Return None: no motion is known."""


class Self(Struct, frozen=True):
    """State of this drone.

    now_ns: own time. epoch: of its local frame.
    sigma_m: 1 sigma of its horizontal position in the mission frame, m; with two position hypotheses, of both together.
    local_from_mission: its local frame; None while it is not known.
    ahead: returns the planned positions (K, 3) from now on, ``step_s`` apart, local frame.
    motion_at: returns position and velocity at a stamp, mission frame; None if this drone did not take part then.
    circle: its circle around the source; None outside of tracking.
    height_m: above ground. returning_s: time since the begin of its return; None if it does not return.
    resumed: its agent was started in flight. measured: ids of drones that may fly, because the log holds their measurements.
    revoked: it is revoked, so no drone accepts its messages. excluded: ids of the other revoked drones.
    otherwise: its local frame, mission from local, by its alternative position hypothesis: the localisation is right after a
        jump; None without one. doubt_m: distance between both hypotheses.
    """

    now_ns: int
    epoch: int
    sigma_m: float
    local_from_mission: Transform | None
    ahead: Callable[[], Array] = _nowhere_ahead
    step_s: float = 0.2
    motion_at: Callable[[int], PeerState | None] = _no_motion
    circle: Circle | None = None
    height_m: float = 0.0
    returning_s: float | None = None
    resumed: bool = False
    measured: Collection[str] = ()
    revoked: bool = False
    excluded: Collection[str] = ()
    otherwise: Transform | None = None
    doubt_m: float = 0.0

    @property
    def place_sigma_m(self) -> float:
        """1 sigma (m) of the own position; with two position hypotheses, that of each one alone."""
        return unexplained_m(self.sigma_m, self.doubt_m)

    def may_fly(self, name: str) -> bool:
        """Whether a drone that has published no stage may be in flight."""
        return self.resumed or name in self.measured

    def elsewhere(self) -> Self | None:
        """Return this state for the alternative position hypothesis; None without one, if the own frame is not known, or late in
        the return of a revoked drone.
        """
        if self.otherwise is None or self.local_from_mission is None:
            return None
        if self.revoked and self.returning_s is not None and self.returning_s >= PATIENT_S:
            return None
        there = self.otherwise.inverse()
        frame = Transform(there.yaw_rad, there.translation, self.local_from_mission.covariance)
        return replace(self, local_from_mission=frame, otherwise=None)

    def viewer(self, local_from_mission: Transform) -> Viewer:
        """Return this state as the rules for missing drones need it, with this frame of the drone."""
        moves = self.ahead, self.motion_at, self.circle, self.height_m, self.returning_s, self.revoked
        return Viewer(self.now_ns, self.epoch, self.step_s, bare(local_from_mission), *moves, excluded=self.excluded)
