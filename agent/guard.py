"""Keeps what goes wrong beside the steps from ending the flight: logged once for each kind, counted, and told as a problem."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Coroutine
from typing import ParamSpec, TypeVar

from agent.logs import Logger

AGAIN_S = 1.0
P = ParamSpec("P")
T = TypeVar("T")


class Guard:
    """Where the exceptions of handlers and background tasks end. ``failures`` counts them by kind."""

    def __init__(self, log: Logger) -> None:
        self.failures: Counter[str] = Counter()
        self._log = log

    def call(self, kind: str, call: Callable[P, T], otherwise: T) -> Callable[P, T]:
        """The same call, but one that fails gives ``otherwise``."""

        def guarded(*args: P.args, **kwargs: P.kwargs) -> T:
            try:
                return call(*args, **kwargs)
            except Exception:
                self._failed(kind)
                return otherwise

        return guarded

    async def work(self, kind: str, work: Callable[[], Coroutine[None, None, None]]) -> None:
        """Do some work to its end; where it fails, do it anew after a pause."""
        while True:
            try:
                await work()
            except Exception:
                self._failed(kind)
            else:
                return
            await asyncio.sleep(AGAIN_S)

    @property
    def problems(self) -> tuple[str, ...]:
        """One line for each kind of failure."""
        return tuple(f"the agent fails in handling {kind}: see its log" for kind in self.failures)

    def _failed(self, kind: str) -> None:
        """Log the present exception with its traceback, the first of its kind only."""
        self.failures[kind] += 1
        if self.failures[kind] == 1:
            self._log.exception("failed; the flight goes on", kind=kind)
