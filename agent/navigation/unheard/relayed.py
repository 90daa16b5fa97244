"""What the statuses of those that are heard tell of drones that are not: whom each has heard in the last 3 s."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from agent.navigation.peers.newest import Peers
from protocol.messages import Status

# Places on a shared circle are kept for this long after the last contact. Each side notices after a second, and moves to a circle
# of its own, 6 m or more from the next, at up to 2 m/s (``agent.motion.orbit``): by then they are 5 m apart.
LEAVING_NS = 5_000_000_000
_RELAYED_NS = 4_000_000_000  # who is gone for good is in no status by then


def relayed(last_ns: Mapping[str, int | None], partners: Sequence[str], peers: Peers) -> set[str]:
    """Missing drones that a partner, which this drone hears, has heard long after this one did: they fly on, and on the same
    side, though neither hears the other.

    ``last_ns``: of each missing drone the stamp of its last contact with this one; None where it was never heard.
    """
    return {
        name
        for name, contact_ns in last_ns.items()
        for status in _statuses(partners, peers)
        if name in status.delays_ns and status.stamp_ns - (contact_ns or 0) > _RELAYED_NS
    }


def is_kept(name: str, last_ns: int | None, partners: Sequence[str], peers: Peers, now_ns: int) -> bool:
    """Whether a missing drone may still be on the same circle: at first, and as long as a partner hears it.

    ``last_ns``: stamp of its last contact with this drone.
    """
    if last_ns is not None and now_ns - last_ns < LEAVING_NS:
        return True
    return any(name in status.delays_ns for status in _statuses(partners, peers))


def _statuses(partners: Sequence[str], peers: Peers) -> list[Status]:
    return [status for partner in partners if (status := peers[partner].status) is not None]
