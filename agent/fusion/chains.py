"""The chain of an estimator's states: extended step by step, and recomputed in parallel after large changes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from radron.agent.frames.batches import Batches
from radron.agent.fusion.checkpoints import thin, undo
from radron.agent.fusion.timeline import Timeline

NEVER = -1  # before every step
# Limit of a replay in a call: 4 ms, in units of ``Estimator.work``, plus a multiple of the present chain's work: it does finish.
_REPLAY_UNITS, _REPLAY_GAIN = 100, 2

Compute = Callable[[Any, int], tuple[Any, int]]  # from the state before a step to the state after it, and its work


class Chains:
    """The states of an estimator, one after each time step with observations, and their recomputation (replay) after late
    entries.

    The present chain of states has priority, and the replay, which will take its place, gets part of the rest of each slice of
    work. The flight must not wait for the replay, nor for other agents on the same computer. On a computer that can barely keep
    up, a replay hardly gains on the present. It then takes the place of the present chain before its end, and every step is
    computed only once. A chain that ``lags``, as after an in-flight start of an agent, has no parallel replay. Its end is too old
    for an estimate, so the chain itself goes back.
    """

    def __init__(self, timeline: Timeline, compute: Compute, batches: Batches) -> None:
        """Start without states. ``batches``: gets the number of calls that each replay took."""
        self._timeline, self._compute, self._batches = timeline, compute, batches
        self._base: Any = None
        self._states: dict[int, Any] = {}  # checkpoints after their steps; ascending: the last one is the chain's end
        self._replay: dict[int, Any] | None = None
        self._calls = 0  # of the present replay
        self._watched = NEVER, NEVER  # first due step of the observation of its pace, and its end then
        self._catches_up = False  # whether the replay has taken the place of the present chain before its end
        self.goes_back = False  # whether this happened in the last call
        self._lagged = 0  # calls for which the chain has lagged

    def begin(self, base: Any) -> None:
        """Discard all states of the estimator, and begin again with the state before the first step."""
        self._base, self._replay, self._catches_up = base, None, False
        self._states.clear()

    @property
    def newest(self) -> tuple[int, Any]:
        """The newest computed time step, and the estimator's state after it."""
        return next(reversed(self._states.items()), (NEVER, self._base))

    @property
    def lags(self) -> bool:
        """Whether the estimator's newest state was, at the last call, too old for a source estimate."""
        return self._lagged > 0

    @property
    def is_replaying(self) -> bool:
        """Whether a recomputation (replay) of the estimator's states after late entries is unfinished."""
        return self._replay is not None or self._catches_up

    def rewind(self, step: int) -> None:
        """Discard the estimator's states after this time step and later ones."""
        undo(self._states, step)
        if self._replay is not None:
            undo(self._replay, step)

    def replay(self, step: int) -> None:
        """Recompute the estimator's states after this time step and later ones, in parallel to the present states if these are of
        use.
        """
        if self._replay is None and (self.lags or self._catches_up):
            self._batches.took(self._lagged)  # the pauses double: however often it begins again, it comes to the end
            undo(self._states, step)
            return
        if self._replay is None:
            self._replay, self._calls, self._watched = dict(self._states), 0, (NEVER, NEVER)
        undo(self._replay, step)
        since, from_step = self._watched
        self._watched = since, min(from_step, next(reversed(self._replay), NEVER))

    def extend(self, due: int, oldest: int, budget: int) -> bool:
        """Compute the estimator's missing states up to the due time step, within the budget of work.

        Return whether all present states are computed. ``oldest``: the chain of states lags if it ends before this step.
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
        """Return whether a replay has, for a while, come less than one step nearer to the due step with each new due step."""
        (since, from_step), end = self._watched, next(reversed(replay), NEVER)
        if since == NEVER or due < since:
            self._watched = due, end
        elif due - since >= while_steps:
            self._watched = due, end
            return end - from_step < 2 * (due - since)
        return False

    def _extended(self, states: dict[int, Any], due: int, budget: int) -> tuple[bool, int]:
        """Compute the states of a chain up to the due step; return whether it is complete, and the rest of the budget."""
        end, state = next(reversed(states.items()), (NEVER, self._base))
        for step in self._timeline.between(end, due):
            if budget <= 0:
                return False, budget
            state, work = self._compute(state, step)
            budget -= work
            states[step] = state
            thin(states)
        return True, budget
