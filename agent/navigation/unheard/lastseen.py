"""Where a drone that is not heard was seen last: it may be hidden for a while, by another one or a wall."""

from __future__ import annotations

from msgspec import Struct

from agent.motion.reference import PeerState
from agent.motion.separation import DOUBT_SIGMAS, PeerPlan
from agent.navigation.peers.placing import WORST_SIGMA_M


class LastSeen(Struct, frozen=True):
    """How it moved at a stamp, own local frame of this epoch, and the error of that place (1 sigma)."""

    stamp_ns: int
    epoch: int
    moves: PeerState
    sigma_m: float

    @classmethod
    def by(cls, seen: PeerPlan, moves: PeerState, epoch: int) -> LastSeen:
        """As it is placed by its sightings now; ``moves``: by the newest of them."""
        return cls(seen.stamp_ns - round(moves.age_s * 1e9), epoch, PeerState(moves.position, moves.velocity), seen.sigma_m)

    def sigma_after_m(self, seconds: float, fastest_mps: float) -> float:
        """Of its place so long after, if it was where it stops: it may have flown on anywhere meanwhile, at that speed."""
        return min(self.sigma_m + fastest_mps * seconds / DOUBT_SIGMAS, WORST_SIGMA_M)
