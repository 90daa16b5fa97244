"""What one drone knows of the others: their newest pose, plan, estimate and status, by age."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from functools import partial

from protocol.messages import Estimate, Plan, Pose, Sighting, Status

ALIVE_NS = 2_000_000_000  # a drone that has not been heard for so long has dropped out
STATUS_AGE_NS = 10_000_000_000  # a drone that was switched off for so long stands against nothing any more
RECENT_NS = 3_000_000_000  # for which poses and sights are kept
_MOST_SIGHTS = 256  # kept, whatever their stamps
FUTURE_NS = 1_000_000_000  # a stamp further ahead than this is a wrong clock, not news


@dataclass(slots=True)
class Peer:
    """The newest of each kind; None until heard. ``poses``, ``sights``: what was heard, and seen by this drone, of late."""

    pose: Pose | None = None
    plan: Plan | None = None
    estimate: Estimate | None = None
    status: Status | None = None
    poses: deque[Pose] = field(default_factory=deque)
    sights: deque[Sighting] = field(default_factory=partial(deque, maxlen=_MOST_SIGHTS))


class Peers:
    """The other drones of the mission, by id."""

    def __init__(self, ids: list[str]) -> None:
        self._peers = {name: Peer() for name in ids}

    def __getitem__(self, drone: str) -> Peer:
        return self._peers[drone]

    @property
    def names(self) -> list[str]:
        """Ids of all, heard or not, sorted."""
        return sorted(self._peers)

    def receive(self, message: Pose | Plan | Estimate | Status, now_ns: int) -> str | None:
        """Keep news; the newest stamp wins. Returns why it was dropped, or None."""
        peer = self._peers.get(message.drone)
        if peer is None:
            return "unknown_drone"
        if message.stamp_ns < now_ns - ALIVE_NS:
            return "stale"
        if message.stamp_ns > now_ns + FUTURE_NS:
            return "from_the_future"
        kind = type(message).__name__.lower()
        known = getattr(peer, kind)
        if known is not None and known.stamp_ns >= message.stamp_ns:
            return "older_than_known"
        setattr(peer, kind, message)
        if isinstance(message, Pose):
            peer.poses.append(message)
            while peer.poses[0].stamp_ns < message.stamp_ns - RECENT_NS:
                peer.poses.popleft()
        return None

    def see(self, sight: Sighting) -> None:
        """Keep what this drone has seen of another one."""
        sights = self._peers[sight.target].sights
        sights.append(sight)
        newest_ns = max(sights[0].stamp_ns, sight.stamp_ns)
        while sights[0].stamp_ns < newest_ns - RECENT_NS:
            sights.popleft()

    def alive(self, now_ns: int) -> list[str]:
        """Ids of those heard of late, sorted."""
        return sorted(
            name for name, peer in self._peers.items() if peer.pose is not None and now_ns - peer.pose.stamp_ns < ALIVE_NS
        )

    def statuses(self, now_ns: int) -> dict[str, Status]:
        """The newest status of each drone that has sent one of late."""
        return {
            name: peer.status
            for name, peer in self._peers.items()
            if peer.status is not None and now_ns - peer.status.stamp_ns < STATUS_AGE_NS
        }
