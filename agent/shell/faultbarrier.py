"""A fault barrier: exceptions outside the pilot's step do not end the flight; they are logged, counted and reported."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Coroutine
from typing import ParamSpec, TypeVar

from radron.agent.shell.logs import Logger
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText, coded

AGAIN_S = 1.0
P = ParamSpec("P")
T = TypeVar("T")


class FaultBarrier:
    """Keeps exceptions of message handlers and background tasks from ending the flight: they are logged, counted and reported.

    ``failures``: number of exceptions by kind of handler.
    """

    def __init__(self, log: Logger) -> None:
        self.failures: Counter[str] = Counter()
        self._log = log

    def call(self, kind: str, call: Callable[P, T], otherwise: T) -> Callable[P, T]:
        """Return a function that makes the call, and returns ``otherwise`` after an exception. kind: name of the handler."""

        def contained(*args: P.args, **kwargs: P.kwargs) -> T:
            try:
                return call(*args, **kwargs)
            except Exception:
                self._failed(kind)
                return otherwise

        return contained

    async def work(self, kind: str, work: Callable[[], Coroutine[None, None, None]]) -> None:
        """Run a background task to its end; after a failure, run it again after a pause."""
        while True:
            try:
                await work()
            except Exception:
                self._failed(kind)
            else:
                return
            await asyncio.sleep(AGAIN_S)

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """A line for the operator for each kind of message handler or task that has failed."""
        return coded(
            Code.INTERNAL_ERROR, (f"internal error in the handling of {kind}: see the agent's log" for kind in self.failures)
        )

    def _failed(self, kind: str) -> None:
        """Log the present exception with its traceback, only the first of each kind."""
        self.failures[kind] += 1
        if self.failures[kind] == 1:
            self._log.exception("internal error; the flight continues", kind=kind)
