"""Which entries of a log count: not those that their drone has taken back, nor exposures of one drone that overlap.

That follows from the set of entries held alone. What changes is noted (``recounted``), so that whoever holds what follows from
the entries can see to it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

from agent.fusion.blocks import Publisher
from agent.fusion.overlaps import Overlaps
from agent.fusion.retractions import Retractions
from agent.fusion.sequences import Range
from protocol.entries import Coverage, Entry, EntryId, Exposure, Retraction

Held = Callable[[Publisher, Iterable[Range]], Iterator[EntryId]]  # the entries held of a publisher with these numbers


class Counting:
    """Of the entries of one log."""

    def __init__(self, held: Held, end_ns: Callable[[EntryId], int | None], *, judges_exposures: bool) -> None:
        """``end_ns``: of an entry held, if it is an exposure. ``judges_exposures``: whether they may not overlap."""
        self._held, self._end_ns = held, end_ns
        self._retractions = Retractions()
        self._overlaps = Overlaps() if judges_exposures else None
        self._recounted: list[tuple[EntryId, bool]] = []

    @property
    def recounted(self) -> Sequence[tuple[EntryId, bool]]:
        """See ``ObservationLog.recounted``."""
        self.settle()
        return self._recounted

    def settle(self) -> None:
        """Count what has been taken back by retractions that were removed since."""
        for publisher, changed in self._retractions.settled():
            for identity in self._held(publisher, changed):
                self._expose(identity, self._end_ns(identity))
                if not self._overlapping(identity):
                    self._recounted.append((identity, True))

    def leaves_out(self, kind: type[Entry], identity: EntryId) -> bool:
        """Whether an entry held does not count. Coverage is not taken back."""
        if kind is Coverage:
            return False
        self.settle()
        return self._retractions.takes_back((identity.drone, identity.boot), identity.sequence) or self._overlapping(identity)

    def overlapping(self, since_ns: int) -> list[str]:
        """The drones with exposures that overlap and have begun since then, sorted."""
        return [] if self._overlaps is None else self._overlaps.drones(since_ns)

    def added(self, entry: Entry, identity: EntryId) -> None:
        """An entry is held from now on, after ``settle``; it counts from the beginning, or does not."""
        publisher = entry.drone, entry.boot
        if isinstance(entry, Retraction):
            for other in self._held(publisher, self._retractions.add(entry)):
                if not self._overlapping(other):
                    self._recounted.append((other, False))
                self._unexpose(other)
        elif isinstance(entry, Exposure) and not self._retractions.takes_back(publisher, entry.sequence):
            self._expose(identity, entry.end_ns)

    def removed(self, identity: EntryId) -> None:
        """An entry is not held any more."""
        self._retractions.remove((identity.drone, identity.boot), identity.sequence)
        self._unexpose(identity)

    def _overlapping(self, identity: EntryId) -> bool:
        return self._overlaps is not None and identity in self._overlaps

    def _expose(self, identity: EntryId, end_ns: int | None) -> None:
        """Judge an exposure that is not taken back beside the others; ``end_ns`` None: it is none."""
        if self._overlaps is not None and end_ns is not None:
            self._recounted += [(other, False) for other in self._overlaps.add(identity, end_ns)]

    def _unexpose(self, identity: EntryId) -> None:
        """Judge the other exposures without this one, if it is any."""
        if self._overlaps is not None:
            self._recounted += [(other, True) for other in self._overlaps.remove(identity)]
