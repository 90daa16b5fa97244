"""Observations by step of the time grid; of one drone only so many count in a step, whatever it publishes."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterator
from operator import attrgetter

from agent.fusion.observation import Observation
from protocol.entries import EntryId

MOST_OBSERVATIONS = 64  # of a drone in a step; cameras yield ten times fewer
_Rank = tuple[str, EntryId]


class Timeline:
    """What was observed in each step. What counts depends on the observations held alone, not on their order of arrival."""

    def __init__(self) -> None:
        self._steps: list[int] = []  # ascending
        self._observations: dict[int, list[Observation]] = {}  # by step, never empty; each drone's together, by identity
        self._step_of: dict[EntryId, int] = {}

    def __len__(self) -> int:
        """Number of steps with observations."""
        return len(self._steps)

    def add(self, step: int, observation: Observation) -> bool:
        """Add an observation; whether that changes what counts in its step."""
        if step not in self._observations:
            self._observations[step] = []
            insort(self._steps, step)
        held = self._observations[step]
        place = bisect_left(held, _rank(observation), key=_rank)
        held.insert(place, observation)
        self._step_of[observation.identity] = step
        return place - _first(held, observation.identity.drone) < MOST_OBSERVATIONS

    def remove(self, identity: EntryId) -> int | None:
        """Remove an entry's observation; the step that has changed by it, or None."""
        step = self._step_of.pop(identity, None)
        if step is None:
            return None
        held = self._observations[step]
        place = bisect_left(held, (identity.drone, identity), key=_rank)
        counted = place - _first(held, identity.drone) < MOST_OBSERVATIONS
        del held[place]
        if not held:
            del self._observations[step], self._steps[bisect_left(self._steps, step)]
        return step if counted else None

    def of(self, step: int) -> list[Observation]:
        """The observations that count in a step, in the order of their entries' identities."""
        return sorted(_counted(self._observations[step]), key=attrgetter("identity"))

    def between(self, after: int, until: int) -> list[int]:
        """The steps with observations after one step, up to another, ascending."""
        return self._steps[bisect_right(self._steps, after) : bisect_right(self._steps, until)]

    def since(self, step: int) -> list[Observation]:
        """All observations from a step on."""
        first = bisect_left(self._steps, step)
        return [observation for step in self._steps[first:] for observation in self._observations[step]]

    def drop_before(self, step: int) -> None:
        """Remove all observations of earlier steps."""
        kept = bisect_left(self._steps, step)
        for dropped in self._steps[:kept]:
            for observation in self._observations.pop(dropped):
                del self._step_of[observation.identity]
        del self._steps[:kept]


def _rank(observation: Observation) -> _Rank:
    return observation.identity.drone, observation.identity


def _drone(observation: Observation) -> str:
    return observation.identity.drone


def _first(held: list[Observation], drone: str) -> int:
    """Where a drone's observations begin."""
    return bisect_left(held, drone, key=_drone)


def _counted(held: list[Observation]) -> Iterator[Observation]:
    """Of each drone as many as count."""
    first = 0
    while first < len(held):
        end = bisect_right(held, _drone(held[first]), lo=first, key=_drone)
        yield from held[first : min(end, first + MOST_OBSERVATIONS)]
        first = end
