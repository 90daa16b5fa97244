"""What was observed, by step of the time grid; of one drone only so much counts in a step, whatever it publishes."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterator

from msgspec import Struct

from protocol.entries import EntryId

MOST_OBSERVATIONS = 64  # of a drone in a step; cameras yield ten times fewer
_Rank = tuple[str, EntryId]


class Seen(Struct, frozen=True, gc=False):
    """An entry that holds an observation, and the epoch of the local frame that it was measured in."""

    identity: EntryId
    epoch: int


class Timeline:
    """Which entries were observed in each step. What counts depends on the entries held alone, not on their order of arrival."""

    def __init__(self) -> None:
        self._steps: list[int] = []  # ascending
        self._seen: dict[int, list[Seen]] = {}  # by step, never empty; each drone's together, by identity
        self._step_of: dict[EntryId, int] = {}

    def __len__(self) -> int:
        """Number of steps with observations."""
        return len(self._steps)

    def add(self, step: int, identity: EntryId, epoch: int) -> bool:
        """Add an entry's observation; whether that changes what counts in its step."""
        if step not in self._seen:
            self._seen[step] = []
            insort(self._steps, step)
        held = self._seen[step]
        place = bisect_left(held, (identity.drone, identity), key=_rank)
        held.insert(place, Seen(identity, epoch))
        self._step_of[identity] = self._steps[bisect_left(self._steps, step)]  # one number in memory for all of its entries
        return place - _first(held, identity.drone) < MOST_OBSERVATIONS

    def step_of(self, identity: EntryId) -> int | None:
        """The step in which an entry was observed; None where it holds no observation."""
        return self._step_of.get(identity)

    def remove(self, identity: EntryId) -> int | None:
        """Remove an entry's observation; the step that has changed by it, or None."""
        step = self._step_of.pop(identity, None)
        if step is None:
            return None
        held = self._seen[step]
        place = bisect_left(held, (identity.drone, identity), key=_rank)
        counted = place - _first(held, identity.drone) < MOST_OBSERVATIONS
        del held[place]
        if not held:
            del self._seen[step], self._steps[bisect_left(self._steps, step)]
        return step if counted else None

    def of(self, step: int) -> list[EntryId]:
        """The entries whose observations count in a step, in the order of their identities."""
        return sorted(_counted(self._seen[step]))

    def between(self, after: int, until: int) -> list[int]:
        """The steps with observations after one step, up to another, ascending."""
        return self._steps[bisect_right(self._steps, after) : bisect_right(self._steps, until)]

    def since(self, step: int) -> list[Seen]:
        """All that was observed from a step on."""
        first = bisect_left(self._steps, step)
        return [seen for step in self._steps[first:] for seen in self._seen[step]]

    def drop_before(self, step: int) -> None:
        """Remove all observations of earlier steps."""
        kept = bisect_left(self._steps, step)
        for dropped in self._steps[:kept]:
            for seen in self._seen.pop(dropped):
                del self._step_of[seen.identity]
        del self._steps[:kept]


def _rank(seen: Seen) -> _Rank:
    return seen.identity.drone, seen.identity


def _drone(seen: Seen) -> str:
    return seen.identity.drone


def _first(held: list[Seen], drone: str) -> int:
    """Where a drone's observations begin."""
    return bisect_left(held, drone, key=_drone)


def _counted(held: list[Seen]) -> Iterator[EntryId]:
    """Of each drone as many as count."""
    first = 0
    while first < len(held):
        end = bisect_right(held, _drone(held[first]), lo=first, key=_drone)
        yield from (seen.identity for seen in held[first : min(end, first + MOST_OBSERVATIONS)])
        first = end
