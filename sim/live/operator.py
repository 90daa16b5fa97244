"""Operator of a live swarm: observes agents and world, sends commands, and waits for conditions."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Collection, Mapping
from contextlib import AsyncExitStack

from radron.agent.config.mission import MissionConfig
from radron.protocol.codec import encode
from radron.protocol.keys import key_of
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.messages import Action, Command, Ticket
from radron.protocol.signing import Trust, Verifier, sign_command
from radron.protocol.stages import ON_GROUND
from radron.protocol.trust import trust_of
from radron.sim.live.agents import Agents
from radron.sim.live.monitor import Observer
from radron.sim.live.processes import Child
from radron.sim.live.view import View
from radron.sim.live.worldlink import Truth
from radron.sim.live.worldprocess import LiveError, WorldProcess

CONDITION_POLL_S = 0.1  # polling interval of conditions
COMMAND_PERIOD_S = 0.5  # interval between copies of a command
RENEW_S = 8.0  # interval of new stamps of a command; agents refuse a start older than 10 s
SIM_STATION = "sim"  # its name in a swarm without certificates


class Operator:
    """The simulated operator of a live swarm, with a station of its own in the network.

    ``observer``: the agents as observed. ``watchers``: functions called with each state of the true world.
    """

    def __init__(self, mission: MissionConfig, world: WorldProcess, agents: Agents, view: View) -> None:
        """``world``: the world process. ``agents``: the agents on this machine. ``view``: receives progress messages."""
        self.mission = mission
        self.world = world
        self.view = view
        self.observer = Observer(mission, time.monotonic)
        self.watchers: list[Callable[[Truth], None]] = []
        self._agents = agents
        self._mesh: Mesh
        self._trust: Trust | None = None  # signs the commands
        self._watching: asyncio.Task[None]

    async def join(self, config: MeshConfig, stack: AsyncExitStack) -> None:
        """Connect to the swarm's network and watch the world, until the stack unwinds."""
        self._trust = trust_of(config.identity)
        self.observer.verifier = Verifier(self._trust.authority, self._trust.revoked) if self._trust is not None else None
        self._mesh = await Mesh.open(config, self.mission.swarm, None, receive=self.observer.receive)
        stack.push_async_callback(self._mesh.close)
        self._watching = asyncio.create_task(self.world.watch(self._see))
        stack.callback(self._watching.cancel)

    @property
    def mesh_counters(self) -> dict[str, int]:
        """Return the counters of this station's link."""
        return dict(self._mesh.counters)

    @property
    def landed(self) -> bool:
        """Return whether all agents are on the ground."""
        return all(agent.stage in ON_GROUND for agent in self.observer.agents)

    async def get_ready(self, within_s: float, without: Collection[str] = ()) -> None:
        """Wait until every agent can be started, and report what they wait for.

        ``without``: drones whose agents are started later.

        Raises:
            LiveError: an agent ends, or they are not ready in time.
        """
        obstacles: list[str] = []

        def ready() -> bool:
            nonlocal obstacles
            before, obstacles = obstacles, self.observer.obstacles(without)
            if obstacles and obstacles != before:
                self.view.say(f"waiting: {'; '.join(obstacles)}")
            ended = [child for child in self._agents.running if child.exit_code is not None]
            if ended:
                raise LiveError(_exit_message(ended[0]))
            return not obstacles

        if not await self.until(ready, within_s):
            raise LiveError(f"the swarm is not ready after {within_s:g} s: {'; '.join(obstacles)}")

    async def command(
        self,
        action: Action,
        obeyed: Callable[[], bool],
        within_s: float | None,
        addressees: Callable[[], tuple[str, ...]] | None = None,
    ) -> bool:
        """Send a command repeatedly until it is obeyed; return whether it was obeyed in time.

        Copies have equal stamps, so that the mission begins at one time for all drones. ``obeyed``: tells whether the command has
        been obeyed. ``addressees``: the drones that have yet to obey; None: all.
        """
        deadline_s = time.monotonic() + (within_s if within_s is not None else float("inf"))
        while not obeyed() and time.monotonic() < deadline_s:
            renew_s, stamp_ns = min(time.monotonic() + RENEW_S, deadline_s), time.time_ns()
            numbers = {agent.drone: ticket.number for agent in self.observer.agents if (ticket := agent.ticket) is not None}
            while time.monotonic() < renew_s:
                drones = None if addressees is None else addressees()
                self._send(action, stamp_ns, {name: numbers[name] for name in numbers if drones is None or name in drones})
                if await self.until(obeyed, COMMAND_PERIOD_S):
                    return True
        return obeyed()

    def _send(self, action: Action, stamp_ns: int, numbers: Mapping[str, int]) -> None:
        """Send a command with these numbers, by drone, and the newest nonces."""
        newest = {agent.drone: agent.ticket for agent in self.observer.agents}
        to = {name: Ticket(ticket.nonce, number) for name, number in numbers.items() if (ticket := newest[name]) is not None}
        if to:
            station = self._trust.name if self._trust is not None else SIM_STATION
            message = Command(stamp_ns=stamp_ns, station=station, mission=self.mission.mission_id, action=action, to=to)
            message = message if self._trust is None else sign_command(message, self._trust)
            self._mesh.publish(key_of(self.mission.swarm, message), encode(message))

    async def until(self, condition: Callable[[], bool], within_s: float | None) -> bool:
        """Wait for a condition; return False if it has not come true in time. Agents that end meanwhile are reported.

        Raises:
            LiveError: the world fails.
        """
        deadline_s = time.monotonic() + (within_s if within_s is not None else float("inf"))
        while not condition():
            if time.monotonic() > deadline_s:
                return False
            if self._watching.done():
                self._watching.result()
            for child in [child for child in self._agents.running if child.exit_code is not None]:
                self._agents.running.remove(child)
                self.view.say(_exit_message(child))
            await asyncio.sleep(CONDITION_POLL_S)
        return True

    def _see(self, truth: Truth) -> None:
        failsafes = [agent.failsafes for agent in self.observer.agents]
        self.observer.look(truth.vehicles, self._mesh.alive)
        for agent, before in zip(self.observer.agents, failsafes, strict=True):
            if agent.failsafes > before:
                self.view.say(f"{agent.drone}: its autopilot's failsafe has taken over")
        for watch in self.watchers:
            watch(truth)


def _exit_message(child: Child) -> str:
    return f"agent {child.name} ended with code {child.exit_code}: {child.last_line()}"
