"""Observations by step of the time grid, with a limit for each drone in a step, whatever it publishes."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterator
from math import ceil

from msgspec import Struct

from radron.protocol.entries import EntryId

MAX_STEP_OBSERVATIONS = 64  # of a drone in a step; cameras yield ten times fewer
MAX_EXPOSURES_PS = 6  # exposures of a drone in a second, and two more: three cameras'; each takes milliseconds of a search
_Kind = tuple[str, bool]  # of observations: the drone, and whether they are exposures


class Seen(Struct, frozen=True, gc=False):
    """A log entry that yields an observation, and the epoch (period without a jump) of its local frame."""

    identity: EntryId
    epoch: int
    is_exposure: bool

    @property
    def kind(self) -> _Kind:
        """Kind of the observation: its drone, and whether it is an exposure (counts) or a cone."""
        return self.identity.drone, self.is_exposure


class Timeline:
    """The observations by step of the estimator's time grid, with a limit for each drone in a step, whatever it publishes.

    Which observations count depends on the entries alone, not on their order of arrival.
    """

    def __init__(self, grid_s: float) -> None:
        """Start without observations. ``grid_s``: width of a step of the time grid."""
        self._max_exposures = min(MAX_STEP_OBSERVATIONS, 2 + ceil(MAX_EXPOSURES_PS * grid_s))
        self._steps: list[int] = []  # ascending
        self._seen: dict[int, list[Seen]] = {}  # by step, never empty; each drone's of a kind together, by identity
        self._step_of: dict[EntryId, int] = {}

    def __len__(self) -> int:
        """Return the number of time steps with observations."""
        return len(self._steps)

    def add(self, step: int, identity: EntryId, epoch: int, *, is_exposure: bool) -> bool:
        """Add an entry's observation to a step; return whether this changes the observations that count in the step."""
        if step not in self._seen:
            self._seen[step] = []
            insort(self._steps, step)
        held = self._seen[step]
        seen = Seen(identity, epoch, is_exposure)
        place = bisect_left(held, _rank(seen), key=_rank)
        held.insert(place, seen)
        self._step_of[identity] = self._steps[bisect_left(self._steps, step)]  # one number in memory for all of its entries
        return place - _first(held, seen.kind) < self._most(seen.kind)

    def step_of(self, identity: EntryId) -> int | None:
        """Return the time step that contains a log entry's observation; None for an entry without observation."""
        return self._step_of.get(identity)

    def remove(self, identity: EntryId) -> int | None:
        """Remove the observation of a log entry; return the time step whose counted observations have changed, or None."""
        step = self._step_of.pop(identity, None)
        if step is None:
            return None
        held = self._seen[step]
        places = [bisect_left(held, (identity.drone, exposed, identity), key=_rank) for exposed in (False, True)]
        place = next(place for place in places if place < len(held) and held[place].identity == identity)
        kind = held[place].kind
        counted = place - _first(held, kind) < self._most(kind)
        del held[place]
        if not held:
            del self._seen[step], self._steps[bisect_left(self._steps, step)]
        return step if counted else None

    def of(self, step: int) -> list[EntryId]:
        """Return the entries whose observations count in a time step, in the order of their identities."""
        return sorted(self._counted(self._seen[step]))

    def between(self, after: int, until: int) -> list[int]:
        """Return the time steps with observations after step ``after``, up to step ``until``, ascending."""
        return self._steps[bisect_right(self._steps, after) : bisect_right(self._steps, until)]

    def since(self, step: int) -> list[Seen]:
        """Return all log entries with observations from a time step on."""
        first = bisect_left(self._steps, step)
        return [seen for step in self._steps[first:] for seen in self._seen[step]]

    def drop_before(self, step: int) -> None:
        """Remove the observations of all time steps before this one."""
        kept = bisect_left(self._steps, step)
        for dropped in self._steps[:kept]:
            for seen in self._seen.pop(dropped):
                del self._step_of[seen.identity]
        del self._steps[:kept]

    def _most(self, kind: _Kind) -> int:
        return self._max_exposures if kind[1] else MAX_STEP_OBSERVATIONS

    def _counted(self, held: list[Seen]) -> Iterator[EntryId]:
        """Yield the counted entries of each drone and kind, up to their limit."""
        first = 0
        while first < len(held):
            kind = held[first].kind
            end = bisect_right(held, kind, lo=first, key=_kind)
            yield from (seen.identity for seen in held[first : min(end, first + self._most(kind))])
            first = end


def _rank(seen: Seen) -> tuple[str, bool, EntryId]:
    return *seen.kind, seen.identity


def _kind(seen: Seen) -> _Kind:
    return seen.kind


def _first(held: list[Seen], kind: _Kind) -> int:
    """Return the index of a drone's first observation of a kind."""
    return bisect_left(held, kind, key=_kind)
