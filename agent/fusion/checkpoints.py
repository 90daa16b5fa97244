"""States of an estimator after some of the steps of a chain: starting points of a replay when an earlier step changes."""

from __future__ import annotations

from typing import TypeVar

MAX_CHECKPOINTS = 12  # 0.2 MB each while `bayes` searches an area of 60 m x 60 m, up to 1.6 MB in larger ones

T = TypeVar("T")


def undo(states: dict[int, T], step: int) -> None:
    """Discard an estimator's states after this time step and later ones. ``states``: by step, ascending."""
    while states and next(reversed(states)) >= step:
        states.popitem()


def thin(states: dict[int, T]) -> None:
    """Limit the number of an estimator's stored states to ``MAX_CHECKPOINTS``, by dropping one. ``states``: by time step,
    ascending.

    Drop the state with the least cost: the additional steps of a replay without it, relative to the necessary steps. The spacing
    then grows with the age, and a late entry costs about twice the steps that it changes, at any age.
    """
    if len(states) <= MAX_CHECKPOINTS:
        return
    held = list(states)
    age = [held[-1] + 1 - index for index in held]
    del states[held[min(range(1, len(held) - 1), key=lambda place: age[place - 1] / age[place + 1])]]
