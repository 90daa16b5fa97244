"""Retractions: entries of a log that do not count, taken back by their own drone as its clock or localisation was wrong.

The result depends on the held retractions alone, not on their order of arrival. A drone can retract only its own entries.
"""

from __future__ import annotations

from collections import defaultdict

from radron.agent.fusion.blocks import Publisher
from radron.agent.fusion.sequences import Range, SequenceSet
from radron.protocol.entries import Retraction


class Retractions:
    """The retractions in a log, by publisher: with them a drone takes back measurements made with a wrong clock or
    localisation.
    """

    def __init__(self) -> None:
        self._held: defaultdict[Publisher, dict[int, Range]] = defaultdict(dict)  # by the retraction's own number
        self._numbers: dict[Publisher, SequenceSet] = {}  # all retracted numbers
        self._stale: set[Publisher] = set()  # publishers with retractions removed since

    def takes_back(self, publisher: Publisher, number: int) -> bool:
        """Return whether a publisher's measurement with that number has been retracted; call ``settled`` before."""
        numbers = self._numbers.get(publisher)
        return numbers is not None and number in numbers

    def add(self, retraction: Retraction) -> list[Range]:
        """Add a retraction, and return the ranges of numbers that are newly retracted by it; call ``settled`` before."""
        publisher = retraction.drone, retraction.boot
        self._held[publisher][retraction.sequence] = retraction.first, retraction.last
        numbers = self._numbers.setdefault(publisher, SequenceSet())
        changed = list(SequenceSet([(retraction.first, retraction.last)]).without(numbers))
        numbers.add_range(retraction.first, retraction.last)
        return changed

    def remove(self, publisher: Publisher, number: int) -> None:
        """Remove the retraction with that number, after its entry was removed from the log; other entries are ignored."""
        if number in self._held.get(publisher, ()):
            del self._held[publisher][number]
            self._stale.add(publisher)

    def settled(self) -> list[tuple[Publisher, list[Range]]]:
        """Return the ranges of numbers that count again, because their retractions have been removed since the last call."""
        if not self._stale:
            return []
        changed = []
        for publisher in sorted(self._stale):
            before, now = self._numbers[publisher], SequenceSet(self._held[publisher].values())
            self._numbers[publisher] = now
            changed.append((publisher, list(before.without(now))))
        self._stale.clear()
        return changed
