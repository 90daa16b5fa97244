"""Plays the faults of a live flight: signals to the agents' processes, impaired links, orders to the world, damaged files."""

from __future__ import annotations

import asyncio
import signal
import sys
from collections.abc import Callable, Coroutine
from itertools import permutations
from math import dist
from random import Random

import msgspec
from msgspec import Struct

from radron.sim.faults.agents import DenseEntries, Disk, Flood, Freeze, Kill, Late, OldEntries, RadioRange, SlowCpu
from radron.sim.faults.base import Fault
from radron.sim.faults.kinds import kind_of
from radron.sim.faults.machines import (
    CameraDead,
    MavlinkImpaired,
    MavlinkLoss,
    SatellitesLost,
    Takeover,
)
from radron.sim.faults.schedule import Active, Schedule
from radron.sim.live.agents import Agents
from radron.sim.live.faults.damage import damage
from radron.sim.live.faults.flooding import FloodPlan
from radron.sim.live.faults.links import impairments, vehicle_impairments
from radron.sim.live.faults.playable import ON_LINKS, late_drones
from radron.sim.live.faults.told import links_told, mavlink_told, vehicle_told
from radron.sim.live.places import Places
from radron.sim.live.processes import Child
from radron.sim.live.relays.launcher import RelayProcess
from radron.sim.live.relays.linkstate import combined
from radron.sim.live.relays.plan import vehicle_of
from radron.sim.live.view import View
from radron.sim.live.worldlink import Order, Truth
from radron.sim.live.worldprocess import WorldProcess
from radron.sim.scenario import Scenario
from radron.sim.vehicle.px4.faults import VehicleFault

AWAKE_S = 0.05  # between two stops of a slow computer: a step
MAX_STOP_S = 0.8  # of a slow computer; after 1 s of silence the watchdog kills the agent
PLAYER_STOP_S = 1.0


class Played(Struct, frozen=True):
    """A fault that was played in a live flight, in words, with its time (s since the operator's start command)."""

    time_s: float
    what: str


class FaultPlayer:
    """Plays a scenario's faults in a live flight.

    ``played``: the actions so far; ``failed``: actions that failed.
    """

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        agents: Agents,
        relays: RelayProcess | None,
        world: WorldProcess,
        view: View,
        places: Places,
    ) -> None:
        """``scenario``: must have passed ``check_playable``. ``relays``: must be given if ``needs_relays`` says so."""
        self.played: list[Played] = []
        self.failed: list[str] = []
        self.late = late_drones(scenario)
        self._swarm = scenario.mission.swarm
        self._drones = [drone.id for drone in scenario.mission.drones]
        self._schedule = Schedule(scenario.fault, self._drones, seed)
        self._random = Random(seed)
        self._agents, self._relays, self._world, self._view, self._places = agents, relays, world, view, places
        self._tasks: dict[tuple[Fault, str], asyncio.Task[None]] = {}
        self._time_s = 0.0

    def step(self, time_s: float, truth: Truth) -> None:
        """Begin and end the faults that are due, ``time_s`` seconds after the start command."""
        self._time_s = time_s
        self._schedule.advance(time_s)
        for one in self._schedule.begun:
            self._strike(one, self._begin)
        for one in self._schedule.ended:
            self._strike(one, self._end)
        if self._relays is not None and (self._schedule.begun or self._schedule.ended or self._schedule.active(RadioRange)):
            self._set_links(self._relays, truth)

    async def close(self) -> None:
        """Stop all actions that still run."""
        for task in self._tasks.values():
            task.cancel()
        await asyncio.gather(*self._tasks.values(), return_exceptions=True)

    def _strike(self, one: Active, act: Callable[[Fault, str], str | None]) -> None:
        fault = one.fault
        if isinstance(fault, ON_LINKS):
            self._note(links_told(fault) if act == self._begin else f"{kind_of(fault)} is over")
            return
        for drone in fault.strikes(self._drones):
            if (what := act(fault, drone)) is not None:
                self._note(f"{drone}: {what}")

    def _note(self, what: str) -> None:
        self.played.append(Played(round(self._time_s, 3), what))
        self._view.say(f"fault at {self._time_s:.1f} s: {what}")

    def _begin(self, fault: Fault, drone: str) -> str | None:
        """Begin a fault of one drone; return a report of the action."""
        match fault:
            case Kill():
                self._agents.signal(drone, signal.SIGKILL)
                return "kill -9 of the agent and its watchdog"
            case Freeze():
                self._agents.signal_agent(drone, signal.SIGSTOP)
                return "the agent is stopped"
            case Late():
                self._go(fault, drone, self._start(drone))
                return "the agent is started, late"
            case SlowCpu():
                self._go(fault, drone, self._slow(drone, fault.late_s))
                return f"steps up to {fault.late_s:g} s late"
            case Flood():
                self._go(fault, drone, self._flood(drone, fault))
                return f"floods the mesh, {fault.rate_mbps:g} MB/s in messages of {fault.message_bytes} bytes"
            case OldEntries():
                self._go(fault, drone, self._flood(drone, fault))
                return f"publishes {fault.per_s:g} log entries of {fault.ago_s:g} s before a second"
            case DenseEntries():
                self._go(fault, drone, self._flood(drone, fault))
                return f"publishes {fault.per_s:g} log entries a second, of the kind {fault.what}"
            case MavlinkLoss():
                return f"{100.0 * fault.probability:g} % of the MAVLink messages are lost"
            case MavlinkImpaired():
                return mavlink_told(fault)
            case Disk():
                return damage(self._agents.folder(drone), fault.how, self._random)
        return self._begin_in_the_world(fault, self._drones.index(drone))

    def _begin_in_the_world(self, fault: Fault, index: int) -> str | None:
        """Begin a fault that the world plays."""
        match fault:
            case CameraDead():
                self._world.order(Order.CAMERA_OFF, index)
                return "no more readouts"
            case SatellitesLost():
                self._world.order(Order.SATELLITES_OFF, index)
                return "no satellites"
            case Takeover():
                self._world.order(Order(f"pilot {fault.mode}"), index)
                return f"a pilot takes over: {fault.mode}"
        if isinstance(fault, VehicleFault):
            self._world.order(Order.BREAK, index, fault)
            return vehicle_told(fault)
        return None

    def _end(self, fault: Fault, drone: str) -> str | None:
        """End a fault of one drone; return a report of the action."""
        index = self._drones.index(drone)
        task = self._tasks.pop((fault, drone), None)
        if task is not None:
            task.cancel()
        match fault:
            case Kill():
                self._go(fault, drone, self._start_again(drone))
                return "the agent is started again"
            case Freeze():
                self._agents.signal_agent(drone, signal.SIGCONT)
                self._go(fault, drone, self._start_again(drone))
                return "the agent is not stopped any more"
            case SlowCpu() | Flood() | OldEntries() | DenseEntries() | MavlinkImpaired():
                return f"{kind_of(fault)} is over"
            case CameraDead():
                self._world.order(Order.CAMERA_ON, index)
                return "readouts again"
            case SatellitesLost():
                self._world.order(Order.SATELLITES_ON, index)
                return "satellites again"
            case Takeover():
                self._world.order(Order.PILOT_HOLD, index)
                return "the pilot gives it back, in hold"
            case MavlinkLoss():
                return "no MAVLink messages are lost any more"
        if isinstance(fault, VehicleFault):
            self._world.order(Order.MEND, index, fault)
            return f"{kind_of(fault)} is over"
        return None

    def _go(self, fault: Fault, drone: str, work: Coroutine[None, None, None]) -> None:
        task = self._tasks[fault, drone] = asyncio.create_task(work)
        task.add_done_callback(lambda ended: self._look_at(ended, f"{drone}: {kind_of(fault)}"))

    def _look_at(self, ended: asyncio.Task[None], what: str) -> None:
        """Report a failed action: a fault that was not played must not pass for a harmless one."""
        error = None if ended.cancelled() else ended.exception()
        if error is not None:
            self.failed.append(f"{what} is not played: {error!r}")
            self._note(self.failed[-1])

    async def _start_again(self, drone: str) -> None:
        """Start an ended agent as its service manager would; a late agent may not have begun yet, or only meanwhile."""
        if await self._agents.has_ended(drone):
            await self._start(drone)

    async def _start(self, drone: str) -> None:
        """Start an agent with the state file that a bad disk left, although the previous agent has saved its state since."""
        for fault, _ in self._schedule.active(Disk, self._drones.index(drone)):
            if fault.how.startswith("state"):
                self._note(f"{drone}: {damage(self._agents.folder(drone), fault.how, self._random)}")
        await self._agents.start(drone)

    async def _slow(self, drone: str, late_s: float) -> None:
        try:
            while True:
                await asyncio.sleep(AWAKE_S)
                self._agents.signal(drone, signal.SIGSTOP)
                await asyncio.sleep(self._random.uniform(0.0, min(late_s, MAX_STOP_S)))
                self._agents.signal(drone, signal.SIGCONT)
        finally:
            self._agents.signal(drone, signal.SIGCONT)

    async def _flood(self, drone: str, fault: Flood | OldEntries | DenseEntries) -> None:
        identity = str(self._agents.folder(drone) / "identity")
        plan = FloodPlan(self._swarm, drone, identity, self._places.mesh, fault)
        command = [sys.executable, "-m", "radron.sim.live.faults.flooding", msgspec.json.encode(plan).decode()]
        child = await Child.start(f"flood of {drone}", command)
        try:
            await child.ended()
            self._note(f"{drone}: its flood ended by itself: {child.last_line()}")
        finally:
            await child.stop(PLAYER_STOP_S)

    def _set_links(self, relays: RelayProcess, truth: Truth) -> None:
        position = dict(zip(self._drones, truth.position_m, strict=True))
        for sender, receiver in permutations(self._drones, 2):
            away_m = dist(position[sender], position[receiver])
            relays.impair(sender, receiver, combined(impairments(self._schedule, self._drones, sender, receiver, away_m)))
        for index, drone in enumerate(self._drones):
            relays.impair(vehicle_of(drone), drone, combined(vehicle_impairments(self._schedule, index, to_agent=True)))
            relays.impair(drone, vehicle_of(drone), combined(vehicle_impairments(self._schedule, index, to_agent=False)))
