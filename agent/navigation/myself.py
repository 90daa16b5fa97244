"""The own drone, as the reckoning with the others needs it."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from agent.frames.transform import Transform
from agent.geometry import Array
from agent.motion.reference import PeerState
from agent.navigation.peers.placing import bare, unexplained_m
from agent.navigation.unheard.contact import Circle
from agent.navigation.unheard.viewer import Viewer

# So long one that is revoked, and returns, gives way to all that may be there if it is not where it takes itself to be. Kept for
# longer from its own home by the homes of others, as they lie to it then, it came down when they took it to have landed.
PATIENT_S = 20.0


def _nowhere_ahead() -> Array:
    return np.zeros((1, 3))


def _no_motion(_: int) -> None:
    """Not known."""


class Self(Struct, frozen=True):
    """The own drone: epoch of its frame, and that frame; None while it is not known.

    ``otherwise``: the same frame, mission from local, if the own localisation that has jumped is right; None without that doubt;
    ``doubt_m``: distance between the places by the two. ``sigma_m``: 1 sigma of the own position in the mission frame (horizontal
    distance), that doubt included. ``ahead``: gives its planned positions (K, 3) from now on, ``step_s`` apart, local frame;
    ``motion_at``: where it was at a stamp, and how fast, mission frame, if it took part then; ``circle``: None where it does not
    track; ``height_m``: above ground; ``returning_s``: since it began to return, None where it does not; ``resumed``: its agent
    was started in flight; ``measured``: the drones that may fly, by the measurements in its log; ``revoked``: nobody hears it;
    ``excluded``: the others that are revoked.
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
        """1 sigma of the own position, of either of the two places where it is in doubt between them."""
        return unexplained_m(self.sigma_m, self.doubt_m)

    def may_fly(self, name: str) -> bool:
        """Whether one that has never told its stage may be in flight."""
        return self.resumed or name in self.measured

    def elsewhere(self) -> Self | None:
        """The same drone if its localisation that has jumped is right; None without that doubt, and where it counts no more."""
        if self.otherwise is None or self.local_from_mission is None:
            return None
        if self.revoked and self.returning_s is not None and self.returning_s >= PATIENT_S:
            return None
        there = self.otherwise.inverse()
        frame = Transform(there.yaw_rad, there.translation, self.local_from_mission.covariance)
        return replace(self, local_from_mission=frame, otherwise=None)

    def viewer(self, local_from_mission: Transform) -> Viewer:
        """As one that keeps clear of drones that are not heard; its frame is known."""
        moves = self.ahead, self.motion_at, self.circle, self.height_m, self.returning_s, self.revoked
        return Viewer(self.now_ns, self.epoch, self.step_s, bare(local_from_mission), *moves, excluded=self.excluded)
