"""Network components, which are the groups of drones in two-way contact while other links are lost, and the circle of each."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from radron.agent.navigation.peers.newest import Peers
from radron.agent.navigation.unheard.contact import SILENT_NS, hears


def side(me: str, missing: Collection[str], partners: Sequence[str], peers: Peers, now_ns: int) -> list[str]:
    """Return the ids of this drone's network component: itself (``me``) and its peers with a two-way link.

    ``missing``: drones without a two-way link to this one; ``partners``: peers with a two-way link that take part.

    A one-way peer does not belong to it. On the circle of such a peer, this drone could meet a third drone that has no link to it
    and belongs to the peer's component.

    A peer with a two-way link that does not take part any more still belongs to it, so that the component keeps its circle when
    its first drone returns. But not if it hears a missing drone, or is silent: then the missing drones might count it, too, and
    two components would fly on one circle.
    """
    found = [me]
    for name in sorted(set(peers.names) - set(missing)):
        pose = peers[name].pose
        if pose is not None and hears(pose, me):
            is_apart = now_ns - pose.stamp_ns > SILENT_NS or any(hears(pose, one) for one in missing)
            found += [name] if name in partners or not is_apart else []
    return found


def ring_of(members: Sequence[str], order: Sequence[str], missing: Collection[str], left: Collection[str]) -> int:
    """Return the number of the circle of a network component: the place of its first member in the mission's order of drones.

    Circle 0 if all drones before that member have left the circle, so that no other component can take circle 0. ``order``: all
    ids, in the order of the mission; ``left``: missing drones that no longer circle.
    """
    first = min(map(order.index, members))
    return 0 if len(left) == len(missing) or is_next(first, order, left) else first


def is_next(index: int, order: Sequence[str], left: Collection[str]) -> bool:
    """Whether all drones before this index of the mission's ``order`` have left the circle: then circle 0 belongs to the drone at
    this index.
    """
    return set(order[:index]) <= set(left)
