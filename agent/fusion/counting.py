"""Counted entries of a log: all but entries retracted by their drone, and overlapping exposures of one drone.

The result follows from the set of held entries alone. Changes are noted (``recounted``) for the owners of derived results.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

from radron.agent.fusion.blocks import Publisher
from radron.agent.fusion.overlaps import Overlaps
from radron.agent.fusion.retractions import Retractions
from radron.agent.fusion.sequences import Range
from radron.protocol.entries import Coverage, Entry, EntryId, Exposure, Retraction

Held = Callable[[Publisher, Iterable[Range]], Iterator[EntryId]]  # the held entries of a publisher with these numbers


class Counting:
    """Decides which entries of a log count: all but entries retracted by their drone, and overlapping exposures of one drone."""

    def __init__(self, held: Held, end_ns: Callable[[EntryId], int | None], *, judges_exposures: bool) -> None:
        """Start without entries.

        ``held``: returns the entries in the log of a publisher with given numbers. ``end_ns``: returns the end of an exposure;
        None for other entries. ``judges_exposures``: whether exposures may not overlap.
        """
        self._held, self._end_ns = held, end_ns
        self._retractions = Retractions()
        self._overlaps = Overlaps() if judges_exposures else None
        self._recounted: list[tuple[EntryId, bool]] = []

    @property
    def recounted(self) -> Sequence[tuple[EntryId, bool]]:
        """The log entries that have ceased to count, or begun to count again; see ``ObservationLog.recounted``."""
        self.settle()
        return self._recounted

    def settle(self) -> None:
        """Let log entries count again whose retractions have been removed since the last call."""
        for publisher, changed in self._retractions.settled():
            for identity in self._held(publisher, changed):
                self._expose(identity, self._end_ns(identity))
                if not self._overlapping(identity):
                    self._recounted.append((identity, True))

    def leaves_out(self, kind: type[Entry], identity: EntryId) -> bool:
        """Return whether an entry in the log does not count. Coverage (a flown part of the survey) cannot be retracted."""
        if kind is Coverage:
            return False
        self.settle()
        return self._retractions.takes_back((identity.drone, identity.boot), identity.sequence) or self._overlapping(identity)

    def overlapping(self, since_ns: int) -> list[str]:
        """Return the drones whose exposures (counts of their camera) overlap, of exposures that began since a time (ns),
        sorted.
        """
        return [] if self._overlaps is None else self._overlaps.drones(since_ns)

    def added(self, entry: Entry, identity: EntryId) -> None:
        """Take a new entry of the log, after ``settle``, and decide whether it counts; a retraction excludes earlier entries."""
        publisher = entry.drone, entry.boot
        if isinstance(entry, Retraction):
            for other in self._held(publisher, self._retractions.add(entry)):
                if not self._overlapping(other):
                    self._recounted.append((other, False))
                self._unexpose(other)
        elif isinstance(entry, Exposure) and not self._retractions.takes_back(publisher, entry.sequence):
            self._expose(identity, entry.end_ns)

    def removed(self, identity: EntryId) -> None:
        """Take note that an entry was removed from the log."""
        self._retractions.remove((identity.drone, identity.boot), identity.sequence)
        self._unexpose(identity)

    def _overlapping(self, identity: EntryId) -> bool:
        return self._overlaps is not None and identity in self._overlaps

    def _expose(self, identity: EntryId, end_ns: int | None) -> None:
        """Compare an unretracted exposure with the others; ``end_ns`` None: the entry is no exposure."""
        if self._overlaps is not None and end_ns is not None:
            self._recounted += [(other, False) for other in self._overlaps.add(identity, end_ns)]

    def _unexpose(self, identity: EntryId) -> None:
        """Judge the other exposures without this entry, if it is an exposure."""
        if self._overlaps is not None:
            self._recounted += [(other, True) for other in self._overlaps.remove(identity)]
