"""State of the own drone for the prediction of the other drones."""

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

# Limit, during the return of a revoked drone, for its alternative position hypothesis. Beyond it, homes of other drones as seen
# from there would keep the drone from its own home until it counts as landed.
PATIENT_S = 20.0


def _nowhere_ahead() -> Array:
    return np.zeros((1, 3))


def _no_motion(_: int) -> None:
    """Return None: no motion is known."""


class Self(Struct, frozen=True):
    """The own drone: epoch of its frame, and that frame; None while it is not known.

    ``otherwise``: the same frame, mission from local, if the own localisation after a jump is right; None without a jump;
    ``doubt_m``: distance between both position hypotheses. ``sigma_m``: 1 sigma of the own position in the mission frame
    (horizontal distance), both hypotheses included. ``ahead``: returns the planned positions (K, 3) from now on, ``step_s``
    apart, local frame; ``motion_at``: position and velocity at a stamp, mission frame, if the drone took part then; ``circle``:
    None outside of tracking; ``height_m``: above ground; ``returning_s``: since the begin of the return, None without a return;
    ``resumed``: in-flight start of the agent; ``measured``: the drones that may fly, by the measurements in the log; ``revoked``:
    no drone hears this one; ``excluded``: the other revoked drones.
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
        """1 sigma of the own position, of either hypothesis if there are two."""
        return unexplained_m(self.sigma_m, self.doubt_m)

    def may_fly(self, name: str) -> bool:
        """Whether a drone without any known stage may be in flight."""
        return self.resumed or name in self.measured

    def elsewhere(self) -> Self | None:
        """Return the drone at its alternative position hypothesis; None without one, or once it no longer counts."""
        if self.otherwise is None or self.local_from_mission is None:
            return None
        if self.revoked and self.returning_s is not None and self.returning_s >= PATIENT_S:
            return None
        there = self.otherwise.inverse()
        frame = Transform(there.yaw_rad, there.translation, self.local_from_mission.covariance)
        return replace(self, local_from_mission=frame, otherwise=None)

    def viewer(self, local_from_mission: Transform) -> Viewer:
        """Return the state for the rules of lost peers; its frame is known."""
        moves = self.ahead, self.motion_at, self.circle, self.height_m, self.returning_s, self.revoked
        return Viewer(self.now_ns, self.epoch, self.step_s, bare(local_from_mission), *moves, excluded=self.excluded)
