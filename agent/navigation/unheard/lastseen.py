"""Last sighting of a drone without a link, for the time in which another drone or a wall occludes it."""

from __future__ import annotations

from msgspec import Struct

from radron.agent.motion.reference import PeerState
from radron.agent.motion.separation import PeerPlan
from radron.agent.navigation.peers.placing import WORST_SIGMA_M
from radron.agent.navigation.peers.relative import UNKNOWN_MPS


class LastSeen(Struct, frozen=True):
    """Position and velocity of the drone at its last sighting, own local frame of ``epoch``; ``sigma_m``: 1 sigma of the
    horizontal position then.
    """

    stamp_ns: int
    epoch: int
    moves: PeerState
    sigma_m: float

    @classmethod
    def by(cls, seen: PeerPlan, moves: PeerState, epoch: int) -> LastSeen:
        """Return the last sighting. ``seen``: present position by all sightings; ``moves``: motion at the newest sighting, with
        its age.
        """
        stamp_ns = seen.stamp_ns - round(moves.age_s * 1e9)
        sigma_m = max(0.0, seen.sigma_m - UNKNOWN_MPS * moves.age_s)
        return cls(stamp_ns, epoch, PeerState(moves.position, moves.velocity), sigma_m)

    def sigma_after_m(self, seconds: float) -> float:
        """Return the 1 sigma (m) of the place where the vehicle stopped, after that time without a sighting. It grows, because
        the vehicle may have flown on; up to ``WORST_SIGMA_M``.
        """
        return min(self.sigma_m + UNKNOWN_MPS * seconds, WORST_SIGMA_M)
