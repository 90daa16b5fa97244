"""Observations by step of the time grid; of one drone only so many count in a step, whatever it publishes."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort

from agent.fusion.observation import Observation
from protocol.entries import EntryId

MOST_OBSERVATIONS = 64  # of a drone in a step; cameras yield ten times fewer


class Timeline:
    """What was observed in each step. What counts depends on the observations held alone, not on their order of arrival."""

    def __init__(self) -> None:
        self._steps: list[int] = []  # ascending
        self._observations: dict[int, dict[EntryId, Observation]] = {}  # by step, never empty
        self._ranked: dict[int, dict[str, list[EntryId]]] = {}  # by step and drone, ascending
        self._step_of: dict[EntryId, int] = {}

    def __len__(self) -> int:
        """Number of steps with observations."""
        return len(self._steps)

    def add(self, step: int, identity: EntryId, observation: Observation) -> bool:
        """Add an observation; whether that changes what counts in its step."""
        if step not in self._observations:
            self._observations[step], self._ranked[step] = {}, {}
            insort(self._steps, step)
        self._observations[step][identity] = observation
        self._step_of[identity] = step
        ranked = self._ranked[step].setdefault(identity.drone, [])
        place = bisect_left(ranked, identity)
        ranked.insert(place, identity)
        return place < MOST_OBSERVATIONS

    def remove(self, identity: EntryId) -> int | None:
        """Remove an entry's observation; the step that has changed by it, or None."""
        step = self._step_of.pop(identity, None)
        if step is None:
            return None
        ranked = self._ranked[step][identity.drone]
        place = bisect_left(ranked, identity)
        del ranked[place], self._observations[step][identity]
        if not self._observations[step]:
            del self._observations[step], self._ranked[step], self._steps[bisect_left(self._steps, step)]
        return step if place < MOST_OBSERVATIONS else None

    def of(self, step: int) -> list[Observation]:
        """The observations that count in a step, in the order of their entries' identities."""
        counted = [identity for ranked in self._ranked[step].values() for identity in ranked[:MOST_OBSERVATIONS]]
        held = self._observations[step]
        return [held[identity] for identity in sorted(counted)]

    def between(self, after: int, until: int) -> list[int]:
        """The steps with observations after one step, up to another, ascending."""
        return self._steps[bisect_right(self._steps, after) : bisect_right(self._steps, until)]

    def since(self, step: int) -> list[Observation]:
        """All observations from a step on."""
        first = bisect_left(self._steps, step)
        return [observation for step in self._steps[first:] for observation in self._observations[step].values()]

    def drop_before(self, step: int) -> None:
        """Remove all observations of earlier steps."""
        kept = bisect_left(self._steps, step)
        for dropped in self._steps[:kept]:
            for identity in self._observations.pop(dropped):
                del self._step_of[identity]
            del self._ranked[dropped]
        del self._steps[:kept]
