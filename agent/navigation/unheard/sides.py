"""Which drones hear each other while others are not heard, and the circle of those that do."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from agent.navigation.peers.newest import Peers
from agent.navigation.unheard.contact import SILENT_NS


def side(me: str, missing: Collection[str], partners: Sequence[str], peers: Peers, now_ns: int) -> list[str]:
    """This drone, ``me``, and those of the heard ones that hear it, too. On the circle of others that do not, it would meet a
    third one that they do not hear either, and that takes itself for one of their side as well.

    Who is heard, but is not one of the ``partners``, which take part, still belongs to it, or the side would have to leave its
    circle whenever its first one returns: but only while that one hears none of the ``missing``. These would count it for their
    side, too, and both sides would fly on one circle.
    """
    found = [me]
    for name in sorted(set(peers.names) - set(missing)):
        status, pose = peers[name].status, peers[name].pose
        if status is not None and me in status.delays_ns:
            is_heard = pose is not None and now_ns - pose.stamp_ns <= SILENT_NS
            belongs = name in partners or (is_heard and status.delays_ns.keys().isdisjoint(missing))
            found += [name] if belongs else []
    return found


def ring_of(members: Sequence[str], order: Sequence[str], missing: Collection[str], left: Collection[str]) -> int:
    """The circle of a side, by its first one; ``order``: all ids, in that of the mission; ``left``: those of the missing that
    circle no more. The shared one where all before that one have left it: no other side can take it.
    """
    first = min(map(order.index, members))
    return 0 if len(left) == len(missing) or is_next(first, order, left) else first


def is_next(index: int, order: Sequence[str], left: Collection[str]) -> bool:
    """Whether all before the drone at this place of the order have left the circle: then the shared one is its side's."""
    return set(order[:index]) <= set(left)
