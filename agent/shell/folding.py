"""A slow estimator, computed in a process of its own: started, asked, and started again where it ends.

The agent's loop only hands over tasks and takes answers, in a few milliseconds each. What it waits for is the pilot's matter: an
older hypothesis serves. Written by hand over asyncio's pipes: the pools of the standard library wait in threads, and do not end
their processes when the agent is killed.
"""

from __future__ import annotations

import asyncio
import os
import pickle
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from agent.config.mission import MissionConfig
from agent.fusion.deferred import Deferred, Task, Told
from agent.fusion.estimator import Estimator
from agent.shell.foldworker import LENGTH, Answer, Order, packed
from agent.shell.logs import Logger
from agent.shell.supervisor import NUMERICS

LOOK_S = 0.05  # between two looks for a question
START_S = 300.0  # for its imports: on an emulated computer these take minutes
ANSWER_S = 120.0  # for a task, of a few seconds; else it hangs
PAUSE_S, LONGEST_PAUSE_S = 1.0, 60.0  # before it is started again: the first time, and at most
_NOT_READY = "the process that computes the source estimate is not ready yet"
_ENDED = "the process that computes the source estimate has ended, and starts again: until then the estimate stays as it was"


class Folding:
    """Computes what a ``Deferred`` asks for; nothing where the estimator is another one, which computes itself.

    ``problem``: why no new answers come, or None.
    """

    def __init__(
        self,
        estimator: Estimator[Any],
        mission: MissionConfig,
        answered: Callable[[int, Told], None],
        log: Logger,
        pause_s: float = PAUSE_S,
    ) -> None:
        """``answered``: takes the answers, see ``Fusion``. ``pause_s``: before the process is started again the first time."""
        self._deferred = estimator if isinstance(estimator, Deferred) else None
        self._answered = answered
        self._order: Order = estimator.name, mission
        self._log = log
        self._pause_s = pause_s
        self.problem = _NOT_READY if self._deferred is not None else None

    async def run(self) -> None:
        """Compute until cancelled."""
        while self._deferred is not None:
            try:
                await self._compute(self._deferred)
            except (OSError, EOFError) as error:
                self.problem = _ENDED
                self._log.error("the process of the estimator has ended", error=repr(error), again_in_s=self._pause_s)
            await asyncio.sleep(self._pause_s)
            self._pause_s = min(2.0 * self._pause_s, LONGEST_PAUSE_S)

    async def _compute(self, deferred: Deferred) -> None:
        """From a start of the process to its end.

        Raises:
            OSError, EOFError: it has ended, or hangs.
        """
        command = [sys.executable, "-m", "agent.shell.foldworker", str(os.getpid())]
        process = await asyncio.create_subprocess_exec(*command, stdin=PIPE, stdout=PIPE, env=NUMERICS | os.environ)
        try:
            held, _ = await _exchanged(process, self._order, START_S)
            self._log.info("the process of the estimator is ready", pid=process.pid)
            self.problem = None
            begun: int | None = None
            while True:
                task = deferred.next_task(held, begun)
                if task is None:
                    if process.returncode is not None:
                        raise EOFError
                    await asyncio.sleep(LOOK_S)
                    continue
                held, told = await _exchanged(process, task, ANSWER_S)
                begun = task.question if told is None else None
                if told is not None:
                    self._answered(task.question, told)
        finally:
            with suppress(ProcessLookupError):
                process.kill()
            await process.wait()


async def _exchanged(process: Process, content: Order | Task, within_s: float) -> Answer:
    """The answer to what is sent."""
    assert process.stdin is not None
    assert process.stdout is not None
    async with asyncio.timeout(within_s):
        process.stdin.write(packed(content))
        await process.stdin.drain()
        (length,) = LENGTH.unpack(await process.stdout.readexactly(LENGTH.size))
        answer: Answer = pickle.loads(await process.stdout.readexactly(length))
        return answer
