"""States of an estimator after some of the steps of a chain: where to go on from, when an earlier step changes."""

from __future__ import annotations

from typing import TypeVar

MOST_CHECKPOINTS = 12  # 0.2 MB each while `bayes` searches an area of 60 m x 60 m, up to 1.6 MB in larger ones

T = TypeVar("T")


def undo(states: dict[int, T], step: int) -> None:
    """Discard the states from the step on. ``states``: by their steps, ascending."""
    while states and next(reversed(states)) >= step:
        states.popitem()


def thin(states: dict[int, T]) -> None:
    """Where there are more than ``MOST_CHECKPOINTS``, drop the one without which replays have to begin earliest, relative to what
    they must compute anyway.

    So the spacing grows with the age, and a late entry costs about twice the steps that it changes, however old it is.
    """
    if len(states) <= MOST_CHECKPOINTS:
        return
    held = list(states)
    age = [held[-1] + 1 - index for index in held]
    del states[held[min(range(1, len(held) - 1), key=lambda place: age[place - 1] / age[place + 1])]]
