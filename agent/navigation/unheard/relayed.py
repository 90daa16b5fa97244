"""Links of lost peers to other drones, by the tables of contacts in the poses of the latter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from radron.agent.navigation.peers.newest import Peers
from radron.agent.navigation.unheard.contact import SILENT_NS, hears
from radron.protocol.messages import Pose

# Retention of a place on the shared circle after the last contact. Each network component notices after a second, and moves to
# its own circle, 6 m or more from the next. At up to 2 m/s (``radron.agent.motion.orbit``), by then they are 5 m apart.
LEAVING_NS = 5_000_000_000


def relayed(last_ns: Mapping[str, int | None], partners: Sequence[str], peers: Peers) -> set[str]:
    """Return the missing drones that a partner of this drone has heard more than a second after this one did. They fly on, in the
    same network component, without a link to this drone.

    ``last_ns``: stamp of the last contact of each missing drone with this one; None: never heard.
    """
    return {
        name
        for name, contact_ns in last_ns.items()
        for pose in _poses(partners, peers)
        if hears(pose, name) and pose.stamp_ns - pose.silences_ns[name] > (contact_ns or 0) + SILENT_NS
    }


def is_kept(name: str, last_ns: int | None, partners: Sequence[str], peers: Peers, now_ns: int) -> bool:
    """Whether a missing drone may still be on the same circle: at first, and as long as a partner hears it.

    ``last_ns``: stamp of its last contact with this drone.
    """
    if last_ns is not None and now_ns - last_ns < LEAVING_NS:
        return True
    return any(hears(pose, name) for pose in _poses(partners, peers))


def _poses(partners: Sequence[str], peers: Peers) -> list[Pose]:
    return [pose for partner in partners if (pose := peers[partner].pose) is not None]
