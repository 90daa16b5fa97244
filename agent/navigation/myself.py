"""The own drone, as the reckoning with the others needs it."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np
from msgspec import Struct

from agent.frames.transform import Transform
from agent.geometry import Array
from agent.motion.reference import PeerState
from agent.navigation.contact import Circle
from agent.navigation.placing import bare
from agent.navigation.silent import Viewer


def _nowhere_ahead() -> Array:
    return np.zeros((1, 3))


def _no_motion(_: int) -> None:
    """Not known."""


class Self(Struct, frozen=True):
    """The own drone: epoch of its frame, and that frame; None while it is not known.

    ``otherwise``: the same frame, mission from local, if the own localisation that has jumped is right; None without that doubt.
    ``sigma_m``: 1 sigma of the own position in the mission frame (horizontal distance). ``ahead``: gives its planned positions
    (K, 3) from now on, ``step_s`` apart, local frame; ``motion_at``: where it was at a stamp, and how fast, mission frame;
    ``circle``: None where it does not track; ``height_m``: above ground; ``returning_s``: since it began to return, None where it
    does not; ``resumed``: its agent was started in flight; ``measured``: the drones that may fly, by the measurements in its log;
    ``revoked``: nobody hears it; ``excluded``: the others that are revoked.
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

    def viewer(self, local_from_mission: Transform) -> Viewer:
        """As one that keeps clear of drones that are not heard; its frame is known."""
        moves = self.ahead, self.motion_at, self.circle, self.height_m, self.returning_s, self.revoked
        return Viewer(self.now_ns, self.step_s, bare(local_from_mission), *moves)
