"""Overlapping exposures of one drone: a drone has one camera, so none of them counts.

The result depends on the set of exposures alone, not on their order of arrival. An exposure overlaps if another exposure of its
drone, of any boot, shares a part of its time. An honest drone publishes no overlaps (``sensing.observer``), except with retracted
exposures, which are not part of the set.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections import defaultdict
from collections.abc import Iterable, Iterator
from operator import itemgetter

from radron.agent.fusion.sequences import SequenceSet
from radron.protocol.entries import EntryId

_Span = tuple[int, int, EntryId]  # begin and end of an exposure, UTC, ns
_end_ns = itemgetter(1)


class Overlaps:
    """Finds overlapping exposures of a drone, which has one camera, so that none of them can be right.

    It holds the exposures of all drones in a log, without the retracted ones.
    """

    def __init__(self) -> None:
        self._drones: defaultdict[str, _Exposed] = defaultdict(_Exposed)

    def add(self, identity: EntryId, end_ns: int) -> list[EntryId]:
        """Add an exposure (counts of a camera). Return the drone's other exposures that overlap now and did not before."""
        return self._drones[identity.drone].add((identity.stamp_ns, end_ns, identity))

    def remove(self, identity: EntryId) -> list[EntryId]:
        """Remove an exposure (counts of a camera). Return the drone's other exposures that do not overlap any more."""
        exposed = self._drones.get(identity.drone)
        return exposed.remove(identity) if exposed is not None else []

    def __contains__(self, identity: EntryId) -> bool:
        """Return whether an exposure (counts of a camera) overlaps another one of its drone."""
        exposed = self._drones.get(identity.drone)
        return exposed is not None and identity in exposed.overlapping

    def drones(self, since_ns: int) -> list[str]:
        """Return the drones with overlapping exposures that began since a time (ns), sorted."""
        return sorted(drone for drone, exposed in self._drones.items() if exposed.newest_ns >= since_ns)


class _Exposed:
    """The exposures of one drone. ``overlapping``: the identities of overlapping exposures."""

    def __init__(self) -> None:
        self.overlapping: set[EntryId] = set()
        self._alone: list[_Span] = []  # ascending; disjoint
        self._crowded: list[_Span] = []  # ascending; overlapping
        self._times = SequenceSet()  # of the overlapping exposures, ns

    @property
    def newest_ns(self) -> int:
        """The latest beginning of an overlapping exposure; -1 without any."""
        return self._crowded[-1][0] if self._crowded else -1

    def add(self, span: _Span) -> list[EntryId]:
        begin_ns, end_ns, _ = span
        first = bisect_right(self._alone, begin_ns, key=_end_ns)
        last = bisect_left(self._alone, (end_ns,))
        met = self._alone[first:last]
        if not met and not self._times.meets(begin_ns, end_ns - 1):
            insort(self._alone, span)
            return []
        del self._alone[first:last]
        self._crowd((span, *met))
        return [identity for _, _, identity in met]

    def remove(self, identity: EntryId) -> list[EntryId]:
        held = self._crowded if identity in self.overlapping else self._alone
        place = bisect_left(held, (identity.stamp_ns,))
        while place < len(held) and held[place][2] != identity:
            place += 1
        if place == len(held):
            return []
        removed = held.pop(place)
        if identity not in self.overlapping:
            return []
        self.overlapping.discard(identity)
        return self._part(removed)

    def _crowd(self, spans: Iterable[_Span]) -> None:
        for span in spans:
            insort(self._crowded, span)
            self.overlapping.add(span[2])
            self._times.add_range(span[0], span[1] - 1)

    def _part(self, removed: _Span) -> list[EntryId]:
        """Judge the group around a removed exposure anew. Returns the exposures that overlap no longer."""
        begin_ns, end_ns = self._times.range_of(removed[0])
        first, last = bisect_left(self._crowded, (begin_ns,)), bisect_left(self._crowded, (end_ns + 1,))
        beside = self._crowded[first:last]
        del self._crowded[first:last]
        self._times = SequenceSet(one for one in self._times if one != (begin_ns, end_ns))
        self.overlapping.difference_update(identity for _, _, identity in beside)
        parted = []
        for group in _groups(beside):
            if len(group) > 1:
                self._crowd(group)
            else:
                insort(self._alone, group[0])
                parted.append(group[0][2])
        return parted


def _groups(spans: list[_Span]) -> Iterator[list[_Span]]:
    """Yield ascending spans in groups that do not overlap each other."""
    group: list[_Span] = []
    until_ns = 0
    for span in spans:
        if group and span[0] >= until_ns:
            yield group
            group = []
        until_ns = max(until_ns, span[1]) if group else span[1]
        group.append(span)
    if group:
        yield group
