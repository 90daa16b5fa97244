"""The processes of the agents: killed, frozen, late, slow, and restarted.

Without its agent a vehicle flies the autopilot's failsafe, and the measurements of its camera are lost. A restarted agent is
a new pilot with a new boot id; it has the state saved on the disk, and gets the log from its peers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum, auto

from radron.agent.mission.memory import Memory
from radron.agent.pilot import Pilot
from radron.agent.vehicle.interface import VehicleCommand
from radron.protocol.messages import Stage
from radron.protocol.revocations import Revocation
from radron.sim.faults.agents import Disk, Freeze, Kill, Late, Revoked, SlowCpu
from radron.sim.faults.base import Fault
from radron.sim.faults.disk import StateDisk
from radron.sim.faults.schedule import Schedule
from radron.sim.vehicle.autopilot import Autopilot

SILENCE_NS = 1_000_000_000  # after a longer gap between its steps an agent is ended (radron.agent.shell.heartbeat)
RESTART_NS = 2_000_000_000  # until the service manager restarts an agent that was ended for slowness
SAVE_PERIOD_NS = 500_000_000  # between two saves of an agent's shell
START_PERIOD_NS = 1_000_000_000  # between two start commands to a late drone
MAX_START_COMMANDS = 60  # then the operator gives up
_ENDING = (Kill, Freeze)
_STRIKING = (*_ENDING, Late, SlowCpu, Disk)

Start = Callable[[int, int, Memory | None], Pilot]  # drone, number of earlier starts, saved state
Gone = Callable[[int], None]
Remind = Callable[[int, Pilot, tuple[Revocation, ...], int], None]  # drone, pilot, saved revocations, time


class Life(Enum):
    """State of an agent's process: it runs, is frozen, or is dead."""

    RUNNING = auto()
    FROZEN = auto()
    DEAD = auto()


class Agent:
    """The agent of one simulated drone: its process and its pilot (the agent's decisions); after death, the last pilot."""

    def __init__(self, pilot: Pilot, autopilot: Autopilot, absent: bool) -> None:
        self.pilot = pilot
        self.life = Life.DEAD if absent else Life.RUNNING
        self.absent = absent  # never started so far
        self.starts = 0 if absent else 1
        self.readings: list[tuple[str, bytes]] = []  # log entries made since the last step
        self.command: VehicleCommand | None = None  # of the last step; None without a step in this tick
        self.sent = 0  # messages published in this tick
        self.disk = StateDisk()
        self.kept: Memory | None = None  # last given to the disk
        self.since_ns = 0  # begin of the present freeze
        self.due_ns = 0  # no step before this
        self.restart_ns: int | None = None
        self._autopilot = autopilot

    @property
    def alive(self) -> bool:
        """Whether the agent's process exists."""
        return self.life is not Life.DEAD

    @property
    def stage(self) -> Stage:
        """Mission stage of the agent; after its death, what the vehicle does: return, then landed.

        An agent restarted after that waits for the operator, and counts as landed.
        """
        if self.absent or (self.alive and (self.starts == 1 or self.pilot.stage is not Stage.PREFLIGHT)):
            return self.pilot.stage
        return Stage.RETURN if self._autopilot.armed else Stage.LANDED


class Crew:
    """All agents of a simulated flight, with the faults of their processes and disks.

    It does nothing in flights without such faults.
    """

    def __init__(
        self,
        faults: Sequence[Fault],
        schedule: Schedule,
        agents: Sequence[Agent],
        start: Start,
        gone: Gone,
        remind: Remind,
    ) -> None:
        """Start with the given agents, without any fault.

        Args:
            faults: faults of the scenario.
            schedule: times of the faults.
            agents: agent of each drone.
            start: makes the pilot of a restarted agent.
            gone: called at an agent's death.
            remind: gives a restarted agent its saved revocations.
        """
        self.agents = list(agents)
        self._schedule = schedule
        self._start, self._gone, self._remind = start, gone, remind
        self._calm = not any(isinstance(fault, _STRIKING) for fault in faults)
        self._calls: dict[int, tuple[int, int]] = {}  # drone: time of the operator's next start command, number so far
        self._look_ns = 0

    @property
    def pilots(self) -> list[Pilot]:
        """Pilots (decision part of the agents) of all drones; of a dead agent the last one."""
        return [agent.pilot for agent in self.agents]

    def advance(self, now_ns: int) -> None:
        """Play the process faults due at a time: agents die, freeze, and start."""
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
            self._look_ns = now_ns + SAVE_PERIOD_NS
            self._look(now_ns)
        for drone, agent in enumerate(self.agents):
            if agent.life is Life.RUNNING and agent.pilot.memory is not agent.kept:
                self._keep(drone, now_ns)

    def steps(self, drone: int, now_ns: int) -> bool:
        """Return whether a drone's agent makes a step now.

        A slow agent is late with its next step, and is ended if that is too late.
        """
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
        """Return the late drones that the operator starts now; the command is repeated until they fly.

        Revoked drones are left out: without links, their status never arrives.
        """
        due = [drone for drone, (when_ns, _) in self._calls.items() if now_ns >= when_ns]
        for drone in due:
            times = self._calls[drone][1] + 1
            revoked = bool(self._schedule.active(Revoked, drone))
            if self.agents[drone].pilot.stage is not Stage.PREFLIGHT or times > MAX_START_COMMANDS or revoked:
                del self._calls[drone]
            else:
                self._calls[drone] = now_ns + START_PERIOD_NS, times
        return [drone for drone in due if drone in self._calls and self.agents[drone].alive]

    def _strike(self, drone: int, fault: Fault, now_ns: int) -> None:
        agent = self.agents[drone]
        if isinstance(fault, Late):
            self._boot(drone, now_ns)
            self._calls[drone] = now_ns + 2 * START_PERIOD_NS, 0  # by then it has received the status of the flying drones
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
        """Save the state left by the steps, twice a second as the agents' shells do, and report failures to the pilot."""
        for drone, agent in enumerate(self.agents):
            if agent.life is Life.RUNNING:
                self._keep(drone, now_ns)
                agent.disk.keep_revoked(agent.pilot.revocations, self._schedule.active(Disk, drone))
                agent.pilot.block(() if agent.disk.problem is None else (agent.disk.problem,))

    def _keep(self, drone: int, now_ns: int) -> None:
        agent = self.agents[drone]
        agent.kept = agent.pilot.memory
        agent.disk.keep(agent.kept, self._schedule.active(Disk, drone), now_ns)
