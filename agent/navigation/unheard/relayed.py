"""Missing drones that a third drone still hears, by the tables of contacts in that drone's poses (``Pose.silences_ns``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from radron.agent.navigation.peers.newest import Peers
from radron.agent.navigation.unheard.contact import SILENT_NS, hears, last_contact_ns
from radron.protocol.messages import Pose

# A missing drone's place on the circle stays free for this long after the last contact. Each network component notices the loss
# after a second, and moves to its own circle, 6 m or more from the next. At up to 2 m/s (``radron.agent.motion.orbit``), the
# drones are 5 m apart by then.
LEAVING_NS = 5_000_000_000


def relayed(last_ns: Mapping[str, int | None], partners: Sequence[str], peers: Peers) -> set[str]:
    """Return the missing drones that a partner (a peer with a two-way link that takes part) has heard more than a second longer
    than this drone. They still fly, in the same network component, without a link to this drone.

    ``last_ns``: stamp of the last contact of each missing drone with this one; None: never heard.
    """
    return {
        name
        for name, contact_ns in last_ns.items()
        for pose in _poses(partners, peers)
        if hears(pose, name) and last_contact_ns(pose, name) > (contact_ns or 0) + SILENT_NS
    }


def is_kept(name: str, last_ns: int | None, partners: Sequence[str], peers: Peers, now_ns: int) -> bool:
    """Whether a missing drone may still be on the same circle: its last contact with this drone or a partner was in the last 5 s.

    ``last_ns``: stamp of its last contact with this drone; None: never heard.
    """
    relayed_ns = [last_contact_ns(pose, name) for pose in _poses(partners, peers) if name in pose.silences_ns]
    own_ns = [] if last_ns is None else [last_ns]
    return any(now_ns - contact_ns < LEAVING_NS for contact_ns in (*own_ns, *relayed_ns))


def _poses(partners: Sequence[str], peers: Peers) -> list[Pose]:
    return [pose for partner in partners if (pose := peers[partner].pose) is not None]
