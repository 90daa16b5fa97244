"""Network components, the groups of drones in two-way contact while other links are lost, and the circle of each."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from radron.agent.navigation.peers.newest import Peers
from radron.agent.navigation.unheard.contact import SILENT_NS, hears


def side(me: str, missing: Collection[str], partners: Sequence[str], peers: Peers, now_ns: int) -> list[str]:
    """Return the network component of this drone, ``me``: itself and the peers with a two-way link. On the circle of one-way
    peers, it could meet a third drone without a link to it that counts itself to the same component.

    A peer with a two-way link that does not take part (not in ``partners``) still belongs to the component. Otherwise the
    component would change its circle whenever its first drone returns. Condition: that peer hears no ``missing`` drone. Otherwise
    the missing drones would count it, too, and two components would fly on one circle.
    """
    found = [me]
    for name in sorted(set(peers.names) - set(missing)):
        pose = peers[name].pose
        if pose is not None and hears(pose, me):
            is_apart = now_ns - pose.stamp_ns > SILENT_NS or any(hears(pose, one) for one in missing)
            found += [name] if name in partners or not is_apart else []
    return found


def ring_of(members: Sequence[str], order: Sequence[str], missing: Collection[str], left: Collection[str]) -> int:
    """Return the circle of a network component, by its first member; ``order``: all ids, in the order of the mission; ``left``:
    missing drones that no longer circle. The shared circle, 0, if all drones before the first member have left it: no other
    component can take it.
    """
    first = min(map(order.index, members))
    return 0 if len(left) == len(missing) or is_next(first, order, left) else first


def is_next(index: int, order: Sequence[str], left: Collection[str]) -> bool:
    """Whether all drones before this index have left the circle: then the shared circle belongs to the component."""
    return set(order[:index]) <= set(left)
