"""A slow estimator, computed in a process of its own: start of the process, tasks and answers, new start after its end.

The agent's loop only hands over tasks and takes answers, in a few milliseconds each. Until an answer comes, the pilot flies by an
older hypothesis. Written by hand over asyncio's pipes: the pools of the standard library wait in threads, and do not end their
processes when the agent is killed.
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

from radron.agent.config.mission import MissionConfig
from radron.agent.fusion.deferred import Deferred, Task, Told
from radron.agent.fusion.estimator import Estimator
from radron.agent.shell.foldworker import LENGTH, Answer, Order, packed
from radron.agent.shell.logs import Logger
from radron.agent.shell.supervisor import NUMERICS
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

LOOK_S = 0.05  # between two checks for a question
START_S = 300.0  # for the process's imports: on an emulated computer these take minutes
ANSWER_S = 120.0  # for a task, of a few seconds; after that the process counts as hung
PAUSE_S, LONGEST_PAUSE_S = 1.0, 60.0  # before a new start of the process: the first, and the longest
_NOT_READY = CodedText(Code.ESTIMATOR_STARTING, "the process that computes the source estimate is not ready yet")
_ENDED = CodedText(
    Code.ESTIMATOR_RESTARTING,
    "the process that computes the source estimate has ended, and starts again: until then the estimate stays as it was",
)


class Folding:
    """Runs the process in which a slow estimator is computed: starts it, sends tasks, takes answers, and starts it again after
    its end.

    Without a ``Deferred`` estimator it does nothing, since the estimator is computed in the agent's own process. ``problem``: why
    new answers are missing, or None.
    """

    def __init__(
        self,
        estimator: Estimator[Any],
        mission: MissionConfig,
        answered: Callable[[int, Told], None],
        log: Logger,
        pause_s: float = PAUSE_S,
    ) -> None:
        """Set up the process.

        ``answered``: takes the answers, see ``Fusion``. ``pause_s``: pause before the first new start of the process.
        """
        self._deferred = estimator if isinstance(estimator, Deferred) else None
        self._answered = answered
        self._order: Order = estimator.name, mission
        self._log = log
        self._pause_s = pause_s
        self.problem = _NOT_READY if self._deferred is not None else None

    async def run(self) -> None:
        """Run the estimator's process, and exchange tasks and answers with it, until cancelled."""
        while self._deferred is not None:
            try:
                await self._compute(self._deferred)
            except (OSError, EOFError) as error:
                self.problem = _ENDED
                self._log.error("the process of the estimator has ended", error=repr(error), again_in_s=self._pause_s)
            await asyncio.sleep(self._pause_s)
            self._pause_s = min(2.0 * self._pause_s, LONGEST_PAUSE_S)

    async def _compute(self, deferred: Deferred) -> None:
        """Start the process, and exchange tasks and answers until the process ends.

        Raises:
            OSError, EOFError: the process has ended, or hangs.
        """
        command = [sys.executable, "-m", "radron.agent.shell.foldworker", str(os.getpid())]
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
    """Send an order or a task and return the answer; raises TimeoutError after ``within_s``."""
    assert process.stdin is not None
    assert process.stdout is not None
    async with asyncio.timeout(within_s):
        process.stdin.write(packed(content))
        await process.stdin.drain()
        (length,) = LENGTH.unpack(await process.stdout.readexactly(LENGTH.size))
        answer: Answer = pickle.loads(await process.stdout.readexactly(length))
        return answer
