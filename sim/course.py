"""The course of a live flight, from agents that wake up to agents that have landed and agree."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack

import numpy as np

from protocol.codec import encode
from protocol.keys import key_of
from protocol.messages import Action, Command, Stage
from protocol.session import Mesh, MeshConfig
from sim.frame import LocalFrames
from sim.livereport import LiveReport, ends_of
from sim.liveview import View
from sim.observer import Observer
from sim.processes import Child
from sim.recorder import Recorder
from sim.result import Flight
from sim.scenario import Scenario
from sim.worldlink import Order, Truth
from sim.worldprocess import LiveError, WorldProcess

TRUTH_S = 0.05  # between two truths
LOOK_S = 0.1  # between two looks at whether something has come about
REPEAT_S = 0.5  # between two copies of a command
RENEW_S = 8.0  # after which a command counts as a new one; agents refuse what is older than 10 s
LANDING_S = 120.0
SETTLE_S = 15.0  # in which the agents' logs become equal once nothing is measured any more
STATION = "sim"


class Course:
    """One flight of a swarm that has been started."""

    def __init__(self, scenario: Scenario, seed: int, world: WorldProcess, agents: Sequence[Child], view: View) -> None:
        """``agents``: those that run on this machine."""
        mission = scenario.mission
        self._seed = seed
        self._mission = mission
        self._world = world
        self._running = list(agents)
        self._view = view
        self._observer = Observer(mission, time.monotonic)
        frames = LocalFrames([(drone.origin_m, drone.yaw_deg) for drone in mission.drones])
        self._recorder = Recorder(scenario, self._observer.agents, frames, TRUTH_S)
        self._went_s: float | None = None  # the world's time when the mission began
        self._over = False
        self._late_s, self._dropped = 0.0, 0
        self._mesh: Mesh
        self._watching: asyncio.Task[None]

    async def join(self, config: MeshConfig, stack: AsyncExitStack) -> None:
        """Join the mesh and watch the world, until the stack unwinds."""
        self._mesh = await Mesh.open(config, self._mission.swarm, None, receive=self._observer.receive)
        stack.push_async_callback(self._mesh.close)
        self._watching = asyncio.create_task(self._world.watch(self._see))
        stack.callback(self._watching.cancel)

    async def fly(self, patience_s: float) -> tuple[Flight, LiveReport]:
        """All of it; the agents get ``patience_s`` to become ready.

        Raises:
            LiveError: they do not, nobody takes off, or the world breaks down.
        """
        began_s = time.monotonic()
        await self._get_ready(patience_s)
        ready_s = time.monotonic() - began_s
        self._view.say(f"all agents are ready after {ready_s:.1f} s: start")
        flight = await self._mission_flown()
        if not self._landed():
            self._view.say("the run is over: the drones land")
            await self._command(Action.LAND, self._landed, LANDING_S)
        self._world.order(Order.CAMERAS_OFF)
        self._view.say("waiting until the agents' logs are equal")
        agreed = await self._until(self._observer.agreed, SETTLE_S)
        return flight, LiveReport(
            agreed=agreed,
            ready_s=ready_s,
            world_late_s=self._late_s,
            truths_dropped=self._dropped,
            mesh=dict(self._mesh.counters),
            agents=ends_of(self._observer.agents, self._world.truth.vehicles),
        )

    async def _get_ready(self, within_s: float) -> None:
        """Wait until every agent can be started; say what is waited for."""
        obstacles: list[str] = []

        def ready() -> bool:
            nonlocal obstacles
            before, obstacles = obstacles, self._observer.obstacles()
            if obstacles and obstacles != before:
                self._view.say(f"waiting: {'; '.join(obstacles)}")
            ended = [child for child in self._running if child.exit_code is not None]
            if ended:
                raise LiveError(_epitaph(ended[0]))
            return not obstacles

        if not await self._until(ready, within_s):
            raise LiveError(f"the swarm is not ready after {within_s:g} s: {'; '.join(obstacles)}")

    async def _mission_flown(self) -> Flight:
        """From the start command to the end of the run, by the scenario's rules."""
        self._world.order(Order.GO)
        began_s = time.monotonic()
        self._went_s, self._observer.entry = self._world.truth.time_s, self._recorder.take
        await self._command(Action.START, self._started, None)
        await self._until(lambda: self._over, None)
        result = self._recorder.result(self._seed, time.monotonic() - began_s)
        try:
            return Flight(result, self._recorder.trace(), {})
        except ValueError:
            raise LiveError(f"nobody took off: {'; '.join(self._observer.obstacles())}") from None

    def _see(self, truth: Truth) -> None:
        """Take a truth: the recorder samples it, whoever looks on sees it."""
        failsafes = [agent.failsafes for agent in self._observer.agents]
        self._observer.look(truth.vehicles, self._mesh.alive)
        for agent, before in zip(self._observer.agents, failsafes, strict=True):
            if agent.failsafes > before:
                self._view.say(f"{agent.drone}: its autopilot's failsafe has taken over")
        time_s = 0.0
        if self._went_s is not None:
            time_s = truth.time_s - self._went_s
            self._late_s, self._dropped = max(self._late_s, truth.late_s), self._dropped + truth.dropped
            if not self._over:
                position, velocity = np.array(truth.position_m), np.array(truth.velocity_mps)
                self._over = self._recorder.sample(time_s, position, velocity, truth.source_m)
        self._view.show(time_s, truth, self._observer.agents)

    def _started(self) -> bool:
        return self._over or all(agent.stage is not Stage.PREFLIGHT for agent in self._observer.agents)

    def _landed(self) -> bool:
        return all(agent.stage in (Stage.LANDED, Stage.PREFLIGHT) for agent in self._observer.agents)

    async def _command(self, action: Action, obeyed: Callable[[], bool], within_s: float | None) -> None:
        """Send a command to all until it is obeyed. Copies are the same command: the mission begins at one time for everybody."""
        deadline_s = time.monotonic() + (within_s if within_s is not None else float("inf"))
        while not obeyed() and time.monotonic() < deadline_s:
            renew_s = time.monotonic() + RENEW_S
            message = Command(stamp_ns=time.time_ns(), station=STATION, mission=self._mission.mission_id, action=action)
            key, payload = key_of(self._mission.swarm, message), encode(message)
            while time.monotonic() < renew_s:
                self._mesh.publish(key, payload)
                if await self._until(obeyed, REPEAT_S):
                    return

    async def _until(self, condition: Callable[[], bool], within_s: float | None) -> bool:
        """Wait for something; False when it has not come about in time. Says which agents end meanwhile."""
        deadline_s = time.monotonic() + (within_s if within_s is not None else float("inf"))
        while not condition():
            if time.monotonic() > deadline_s:
                return False
            if self._watching.done():
                self._watching.result()
            for child in [child for child in self._running if child.exit_code is not None]:
                self._running.remove(child)
                self._view.say(_epitaph(child))
            await asyncio.sleep(LOOK_S)
        return True


def _epitaph(child: Child) -> str:
    return f"agent {child.name} ended with code {child.exit_code}: {child.last_line()}"
