"""The newest pose, plan and status of every other drone, and this drone's relative observations of it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from functools import partial

from protocol.entries import Sighting
from protocol.messages import Plan, Pose, Stage, Status

OLDEST_NS = 2_000_000_000  # an older message is dropped
STATUS_AGE_NS = 10_000_000_000  # an older status does not count: the drone is switched off
RECENT_NS = 3_000_000_000  # poses and sightings are kept for this long
_AT_LAUNCH = (Stage.PREFLIGHT, Stage.TAKEOFF)
_MOST_SIGHTINGS = 256  # kept, whatever their stamps
FUTURE_NS = 100_000_000  # a stamp further ahead than this, and than the clocks are known to differ, is forged or a wrong clock's
MOST_AHEAD_NS = 1_000_000_000  # however far the clocks differ


@dataclass(slots=True)
class Peer:
    """The newest of each kind; None until heard. ``poses``, ``sightings`` (by this drone): of the last seconds.

    ``launch``: its last pose before it left the place of its launch.
    """

    pose: Pose | None = None
    plan: Plan | None = None
    status: Status | None = None
    launch: Pose | None = None
    poses: deque[Pose] = field(default_factory=deque)
    sightings: deque[Sighting] = field(default_factory=partial(deque, maxlen=_MOST_SIGHTINGS))


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

    def receive(self, message: Pose | Plan | Status, now_ns: int, behind_ns: int = 0) -> str | None:
        """Keep a message if its stamp is newer. Returns why it was dropped, or None.

        ``behind_ns``: how far the own clock is known to be behind that of the sender.
        """
        peer = self._peers.get(message.drone)
        if peer is None:
            return "unknown_drone"
        if message.stamp_ns < now_ns - OLDEST_NS:
            return "stale"
        if message.stamp_ns > now_ns + min(FUTURE_NS + behind_ns, MOST_AHEAD_NS):
            return "from_the_future"
        kind = type(message).__name__.lower()
        known = getattr(peer, kind)
        if known is not None and known.stamp_ns >= message.stamp_ns:
            return "older_than_known"
        setattr(peer, kind, message)
        if isinstance(message, Pose):
            peer.poses.append(message)
            if peer.status is not None and peer.status.stage in _AT_LAUNCH:
                peer.launch = message
            while peer.poses[0].stamp_ns < message.stamp_ns - RECENT_NS:
                peer.poses.popleft()
        return None

    def see(self, sighting: Sighting) -> None:
        """Keep this drone's own sighting of another one."""
        sightings = self._peers[sighting.target].sightings
        sightings.append(sighting)
        newest_ns = max(sightings[0].stamp_ns, sighting.stamp_ns)
        while sightings[0].stamp_ns < newest_ns - RECENT_NS:
            sightings.popleft()

    def statuses(self, now_ns: int) -> dict[str, Status]:
        """The newest status of each drone that has sent one recently."""
        return {
            name: peer.status
            for name, peer in self._peers.items()
            if peer.status is not None and now_ns - peer.status.stamp_ns < STATUS_AGE_NS
        }
