"""Live flight: passes messages of the swarm's network on to the web pages, as long as the station runs."""

from __future__ import annotations

import asyncio
import logging
import sys
import time
from collections.abc import Callable
from contextlib import AsyncExitStack

import structlog

from radron.agent.shell.folding import Folding
from radron.protocol.mesh.recovery import recover
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.texts import CodedText
from radron.station.commander import Commander, may_command
from radron.station.hub import Hub
from radron.station.picture.picture import Picture

SHOW_S = 0.1  # interval of the frames


async def follow(hub: Hub, config: MeshConfig) -> None:
    """Join the swarm's network and show its messages on the web pages, until cancelled.

    Raises:
        MeshError: the network cannot be joined as configured.
    """
    listeners: list[Callable[[str, bytes], None]] = []

    def receive(key: str, payload: bytes) -> None:
        hub.picture.receive(key, payload, time.time_ns())
        for listen in listeners:
            listen(key, payload)

    def summary() -> bytes:
        return hub.picture.log.summary()

    async with AsyncExitStack() as stack:
        swarm, members = hub.picture.mission.swarm, tuple(hub.picture.members)
        mesh = await Mesh.open(config, swarm, None, receive=receive, members=members)
        stack.push_async_callback(mesh.close)
        if may_command(config.identity):
            commander = Commander(mesh, swarm, config.identity, hub.tell)
            listeners.append(commander.receive)
            stack.push_async_callback(commander.close)
            hub.picture.orders.own = commander.name
            hub.command = commander.give
            hub.upload = lambda mission, age_s: commander.upload(mission, hub.adopt, age_s)
        recovering = asyncio.create_task(recover(lambda: mesh.alive, summary, mesh.ask, phase=0.0))
        stack.callback(recovering.cancel)
        loop = asyncio.get_running_loop()
        due_s, slow = loop.time(), SlowEstimates()
        stack.push_async_callback(slow.end)
        while True:
            picture = hub.picture  # replaced after an upload
            await slow.follow(picture)
            picture.advance(time.time_ns())
            if loop.time() >= due_s:  # same rate with work pending: a frame costs as much as a slice of work
                due_s = max(due_s + SHOW_S, loop.time())
                picture.appear(mesh.alive)
                picture.link_problems = (*mesh.problems, *mesh.differing, *slow.problems)
                hub.show(time.time_ns())
            if recovering.done():
                recovering.result()
            await asyncio.sleep(due_s - loop.time() if not picture.log.pending else 0.0)


class SlowEstimates:
    """Runs a slow estimator in a process of its own, as the drones do, so that the web pages do not wait for its steps."""

    def __init__(self) -> None:
        self._picture: Picture | None = None
        self._folding: Folding | None = None
        self._task: asyncio.Task[None] | None = None

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """Why the displayed estimate is not current; empty if it is."""
        problem = self._folding.problem if self._folding is not None else None
        return () if problem is None else (problem,)

    async def follow(self, picture: Picture) -> None:
        """Run the estimator for the log of this picture (the station's state of the swarm), and no longer for an earlier one."""
        if picture is self._picture:
            if self._task is not None and self._task.done():
                self._task.result()  # ends only by a bug, raised here
            return
        await self.end()
        fusion, self._picture = picture.log.fusion, picture
        self._folding = Folding(fusion.estimator, picture.mission, fusion.answered, _errors_only())
        self._task = asyncio.create_task(self._folding.run())

    async def end(self) -> None:
        """Stop the estimator's process."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)


def _errors_only() -> structlog.typing.FilteringBoundLogger:
    """Return a log of errors on the error stream."""
    log: structlog.typing.FilteringBoundLogger = structlog.wrap_logger(
        structlog.PrintLogger(sys.stderr), wrapper_class=structlog.make_filtering_bound_logger(logging.ERROR)
    )
    return log
