"""The processes of the agents: they are killed, stand still, come late, are slow, and are started again.

While an agent is gone its vehicle flies the autopilot's failsafe, and what its camera measures is lost. An agent that is started
again is a new pilot with a new boot id, which knows only what the disk has kept of the state and gets the log from its peers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum, auto

from agent.mission.memory import Memory
from agent.pilot import Pilot
from agent.vehicle.interface import VehicleCommand
from protocol.messages import Stage
from protocol.revocations import Revocation
from sim.faults.agents import Disk, Freeze, Kill, Late, Revoked, SlowCpu
from sim.faults.base import Fault
from sim.faults.disk import StateDisk
from sim.faults.schedule import Schedule
from sim.vehicle.autopilot import Autopilot

SILENCE_NS = 1_000_000_000  # after a longer gap between its steps an agent is ended (agent.shell.heartbeat)
RESTART_NS = 2_000_000_000  # until the service manager has started one again that was ended for being slow
LOOK_NS = 500_000_000  # between two looks of an agent's shell at what has to be saved
CALL_NS = 1_000_000_000  # between two start commands to a drone that is late
MOST_CALLS = 60  # then the operator gives up
_ENDING = (Kill, Freeze)
_STRIKING = (*_ENDING, Late, SlowCpu, Disk)

Start = Callable[[int, int, Memory | None], Pilot]  # of a drone, for the n-th time, with the state that was kept
Gone = Callable[[int], None]
Remind = Callable[[int, Pilot, tuple[Revocation, ...], int], None]  # of what the disk has kept of revocations; with the time


class Life(Enum):
    """State of a process."""

    RUNNING = auto()
    FROZEN = auto()
    DEAD = auto()


class Agent:
    """The agent of one drone: its process, and the pilot in it (of a dead one: the last)."""

    def __init__(self, pilot: Pilot, autopilot: Autopilot, absent: bool) -> None:
        self.pilot = pilot
        self.life = Life.DEAD if absent else Life.RUNNING
        self.absent = absent  # never started so far
        self.starts = 0 if absent else 1
        self.readings: list[tuple[str, bytes]] = []  # log entries made since the last step
        self.command: VehicleCommand | None = None  # of the last step; None where there was none in this tick
        self.sent = 0  # messages published in this tick
        self.disk = StateDisk()
        self.kept: Memory | None = None  # what was last given to the disk
        self.since_ns = 0  # since when it has been frozen
        self.due_ns = 0  # no step before this
        self.restart_ns: int | None = None
        self._autopilot = autopilot

    @property
    def alive(self) -> bool:
        """Whether there is a process."""
        return self.life is not Life.DEAD

    @property
    def stage(self) -> Stage:
        """Its stage; that of its vehicle after its death: it returns, then it has landed. An agent that was started again after
        that waits for the operator, and counts as landed.
        """
        if self.absent or (self.alive and (self.starts == 1 or self.pilot.stage is not Stage.PREFLIGHT)):
            return self.pilot.stage
        return Stage.RETURN if self._autopilot.armed else Stage.LANDED


class Crew:
    """The agents of a flight. Without a fault of a process or disk nothing happens here."""

    def __init__(
        self,
        faults: Sequence[Fault],
        schedule: Schedule,
        agents: Sequence[Agent],
        start: Start,
        gone: Gone,
        remind: Remind,
    ) -> None:
        """Args:
        faults: of the scenario.
        schedule: what is active of them.
        agents: by drone.
        start: makes the pilot of an agent that is started again.
        gone: called when an agent has died.
        remind: tells an agent that is started again of the revocations that it knew before.
        """
        self.agents = list(agents)
        self._schedule = schedule
        self._start, self._gone, self._remind = start, gone, remind
        self._calm = not any(isinstance(fault, _STRIKING) for fault in faults)
        self._calls: dict[int, tuple[int, int]] = {}  # drone: when the operator starts it next, and how often he has
        self._look_ns = 0

    @property
    def pilots(self) -> list[Pilot]:
        """The pilots of all drones; of a dead agent the last one."""
        return [agent.pilot for agent in self.agents]

    def advance(self, now_ns: int) -> None:
        """Go on to a time: agents die, stand still, and are started."""
        if self._calm:
            return
        for active in self._schedule.begun:
            for drone in sorted(active.drones):
                self._strike(drone, active.fault, now_ns)
        for active in self._schedule.ended:
            for drone in sorted(active.drones):
                self._release(drone, active.fault, now_ns)
        for drone, agent in enumerate(self.agents):
            if agent.life is Life.FROZEN and now_ns - agent.since_ns > SILENCE_NS:
                self._die(drone)
            elif agent.restart_ns is not None and now_ns >= agent.restart_ns:
                self._boot(drone, now_ns)
        if now_ns >= self._look_ns:
            self._look_ns = now_ns + LOOK_NS
            self._look(now_ns)
        for drone, agent in enumerate(self.agents):
            if agent.life is Life.RUNNING and agent.pilot.memory is not agent.kept:
                self._keep(drone, now_ns)

    def steps(self, drone: int, now_ns: int) -> bool:
        """Whether the agent makes a step now. A slow one is late with its next step, and ended where that is too late."""
        agent = self.agents[drone]
        if self._calm:
            return True
        if agent.life is not Life.RUNNING or now_ns < agent.due_ns:
            return False
        late_ns = sum(int(1e9 * fault.late_s * one.rng.random()) for fault, one in self._schedule.active(SlowCpu, drone))
        agent.due_ns = now_ns + late_ns
        if late_ns > SILENCE_NS:
            agent.life, agent.since_ns, agent.restart_ns = Life.FROZEN, now_ns, now_ns + SILENCE_NS + RESTART_NS
        return True

    def called(self, now_ns: int) -> list[int]:
        """The late drones that the operator starts now; again and again until they fly. Not those that he has revoked: nobody
        would hear them, nor they that they are, as they have no links any more.
        """
        due = [drone for drone, (when_ns, _) in self._calls.items() if now_ns >= when_ns]
        for drone in due:
            times = self._calls[drone][1] + 1
            revoked = bool(self._schedule.active(Revoked, drone))
            if self.agents[drone].pilot.stage is not Stage.PREFLIGHT or times > MOST_CALLS or revoked:
                del self._calls[drone]
            else:
                self._calls[drone] = now_ns + CALL_NS, times
        return [drone for drone in due if drone in self._calls and self.agents[drone].alive]

    def _strike(self, drone: int, fault: Fault, now_ns: int) -> None:
        agent = self.agents[drone]
        if isinstance(fault, Late):
            self._boot(drone, now_ns)
            self._calls[drone] = now_ns + 2 * CALL_NS, 0  # by then it has heard the status of those that fly
        elif isinstance(fault, Kill) and agent.alive:
            self._die(drone)
        elif isinstance(fault, Freeze) and agent.life is Life.RUNNING:
            agent.life, agent.since_ns = Life.FROZEN, now_ns

    def _release(self, drone: int, fault: Fault, now_ns: int) -> None:
        agent = self.agents[drone]
        held = any(self._schedule.active(kind, drone) for kind in _ENDING)
        if not isinstance(fault, _ENDING) or held or agent.absent:
            return
        if agent.life is Life.FROZEN and agent.restart_ns is None and now_ns - agent.since_ns <= SILENCE_NS:
            agent.life = Life.RUNNING
        else:
            self._boot(drone, now_ns)

    def _die(self, drone: int) -> None:
        agent = self.agents[drone]
        agent.life = Life.DEAD
        agent.readings.clear()
        self._gone(drone)

    def _boot(self, drone: int, now_ns: int) -> None:
        agent = self.agents[drone]
        self._gone(drone)
        agent.pilot = self._start(drone, agent.starts, agent.disk.load(self._schedule.active(Disk, drone)))
        if agent.disk.revoked:
            self._remind(drone, agent.pilot, agent.disk.revoked, now_ns)
        agent.life, agent.absent, agent.restart_ns = Life.RUNNING, False, None
        agent.starts += 1
        agent.due_ns = 0

    def _look(self, now_ns: int) -> None:
        """What the agents' shells do twice a second: save what the steps have left, and tell the pilot where that fails."""
        for drone, agent in enumerate(self.agents):
            if agent.life is Life.RUNNING:
                self._keep(drone, now_ns)
                agent.disk.keep_revoked(agent.pilot.revocations, self._schedule.active(Disk, drone))
                agent.pilot.block((agent.disk.problem,) if agent.disk.problem else ())

    def _keep(self, drone: int, now_ns: int) -> None:
        agent = self.agents[drone]
        agent.kept = agent.pilot.memory
        agent.disk.keep(agent.kept, self._schedule.active(Disk, drone), now_ns)
