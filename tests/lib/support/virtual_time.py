"""Courses of asyncio in virtual time: waiting takes none of the wall's, and how fast the machine is changes nothing."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from selectors import SelectorKey, SelectSelector
from typing import TypeVar

T = TypeVar("T")


class _Clock(SelectSelector):
    """A selector that does not wait until a time, but has it come at once. ``now_s``: the time."""

    now_s = 0.0

    def select(self, timeout: float | None = None) -> list[tuple[SelectorKey, int]]:
        ready = super().select(None if timeout is None else 0.0)
        if not ready and timeout is not None:
            self.now_s += max(0.0, timeout)
        return ready


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """An event loop; its time jumps to the next timer whenever there is nothing to do. For courses without I/O."""

    def __init__(self) -> None:
        self._clock = _Clock()
        super().__init__(self._clock)

    def time(self) -> float:
        return self._clock.now_s


def run(course: Coroutine[object, object, T]) -> T:
    """As ``asyncio.run``."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(course)
