"""The chain of an estimator's states: extended step by step, and computed again beside itself where much of it changes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from agent.frames.batches import Batches
from agent.fusion.checkpoints import thin, undo
from agent.fusion.timeline import Timeline

NEVER = -1  # before every step
# Of a replay in a call, units of ``Estimator.work``: 4 ms, and so many times what the present chain takes: it comes to its end.
_REPLAY_UNITS, _REPLAY_GAIN = 100, 2

Compute = Callable[[Any, int], tuple[Any, int]]  # from the state before a step to the one after it, and the work that it took


class Chains:
    """The present chain of states, and the replay that is to take its place.

    The present chain goes first, and the replay gets some of what is left of each slice of work: the flight must not wait for it,
    nor for those of other agents on the same computer. Where that is so little that it hardly gains on the present, as on a
    computer that is not much faster than what is new takes, it takes the place of the present chain before its end: what there is
    to be computed is computed once then. Nor is anything replayed beside a chain that ``lags``, as after the start of an agent in
    flight: its end is too old to tell a hypothesis, so it goes back itself.
    """

    def __init__(self, timeline: Timeline, compute: Compute, batches: Batches) -> None:
        """``batches``: are told how many calls a replay has taken."""
        self._timeline, self._compute, self._batches = timeline, compute, batches
        self._base: Any = None
        self._states: dict[int, Any] = {}  # checkpoints after their steps; ascending: the last one is the chain's end
        self._replay: dict[int, Any] | None = None
        self._calls = 0  # of the present replay
        self._watched = NEVER, NEVER  # since which due step it has been watched, and its end then
        self._catches_up = False  # whether it has taken the place of the present chain before its end
        self.goes_back = False  # whether it did so in the last call
        self._lagged = 0  # calls for which the chain has lagged

    def begin(self, base: Any) -> None:
        """Begin anew, with the state before the first step."""
        self._base, self._replay, self._catches_up = base, None, False
        self._states.clear()

    @property
    def newest(self) -> tuple[int, Any]:
        """The newest step of the present chain, and the state after it."""
        return next(reversed(self._states.items()), (NEVER, self._base))

    @property
    def lags(self) -> bool:
        """Whether the present chain ended, at the last call, too early to tell a hypothesis."""
        return self._lagged > 0

    @property
    def is_replaying(self) -> bool:
        """Whether a replay is unfinished."""
        return self._replay is not None or self._catches_up

    def rewind(self, step: int) -> None:
        """Discard the states from the step on."""
        undo(self._states, step)
        if self._replay is not None:
            undo(self._replay, step)

    def replay(self, step: int) -> None:
        """Compute the states from the step on again, beside the present ones if these are of use."""
        if self._replay is None and (self.lags or self._catches_up):
            self._batches.took(self._lagged)  # so the pauses double: however often it begins again, it comes to the end
            undo(self._states, step)
            return
        if self._replay is None:
            self._replay, self._calls, self._watched = dict(self._states), 0, (NEVER, NEVER)
        undo(self._replay, step)
        since, from_step = self._watched
        self._watched = since, min(from_step, next(reversed(self._replay), NEVER))

    def extend(self, due: int, oldest: int, budget: int) -> bool:
        """Compute what is missing up to the due step, within the budget; whether the present chain is complete.

        ``oldest``: where the chain ends before that step, it lags.
        """
        self.goes_back = False
        complete, left = self._extended(self._states, due, budget)
        if self._replay is not None:
            self._calls += 1
            share = min(left, _REPLAY_UNITS + _REPLAY_GAIN * (budget - left))
            if complete and left > 0 and self._extended(self._replay, due, share)[0]:
                self._states, self._replay = self._replay, None
                self._batches.took(self._calls)
            elif self._is_too_slow(self._replay, due, due - oldest):
                self._states, self._replay, self._catches_up, self.goes_back = self._replay, None, True, True
        elif self._catches_up:
            self._calls += 1
            if complete:
                self._catches_up = False
                self._batches.took(self._calls)
        self._lagged = 0 if complete or self.newest[0] >= oldest else self._lagged + 1
        return complete

    def _is_too_slow(self, replay: dict[int, Any], due: int, while_steps: int) -> bool:
        """Whether a replay has, for a while, come less than one step nearer to the due one with each that became due."""
        (since, from_step), end = self._watched, next(reversed(replay), NEVER)
        if since == NEVER or due < since:
            self._watched = due, end
        elif due - since >= while_steps:
            self._watched = due, end
            return end - from_step < 2 * (due - since)
        return False

    def _extended(self, states: dict[int, Any], due: int, budget: int) -> tuple[bool, int]:
        """Compute the states of a chain up to the due step; whether it is complete, and what is left of the budget."""
        end, state = next(reversed(states.items()), (NEVER, self._base))
        for step in self._timeline.between(end, due):
            if budget <= 0:
                return False, budget
            state, work = self._compute(state, step)
            budget -= work
            states[step] = state
            thin(states)
        return True, budget
