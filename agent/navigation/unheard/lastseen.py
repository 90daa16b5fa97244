"""Last sighting of a lost peer, which another drone or a wall may occlude for a while."""

from __future__ import annotations

from msgspec import Struct

from radron.agent.motion.reference import PeerState
from radron.agent.motion.separation import PeerPlan
from radron.agent.navigation.peers.placing import WORST_SIGMA_M
from radron.agent.navigation.peers.relative import UNKNOWN_MPS


class LastSeen(Struct, frozen=True):
    """Motion at a stamp, own local frame of this epoch, and the position uncertainty (1 sigma)."""

    stamp_ns: int
    epoch: int
    moves: PeerState
    sigma_m: float

    @classmethod
    def by(cls, seen: PeerPlan, moves: PeerState, epoch: int) -> LastSeen:
        """Derive it from the present position by sightings, ``seen``, and the motion by the newest of them, ``moves``."""
        stamp_ns = seen.stamp_ns - round(moves.age_s * 1e9)
        sigma_m = max(0.0, seen.sigma_m - UNKNOWN_MPS * moves.age_s)
        return cls(stamp_ns, epoch, PeerState(moves.position, moves.velocity), sigma_m)

    def sigma_after_m(self, seconds: float) -> float:
        """Position uncertainty of the stop after that time, if the peer stopped: it may have flown on; same growth as if seen."""
        return min(self.sigma_m + UNKNOWN_MPS * seconds, WORST_SIGMA_M)
