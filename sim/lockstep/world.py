"""A simulated flight in lockstep, tick by tick (time step of 50 ms): the world, and the agents in it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from radron.agent.computing import Computing
from radron.agent.mission.memory import Memory
from radron.agent.pilot import Pilot
from radron.protocol.messages import Action
from radron.sim.faults.agents import Late
from radron.sim.faults.crowding import Crowds
from radron.sim.faults.disk import check_playable
from radron.sim.faults.forgers import Forgers, OldCommands
from radron.sim.faults.network import FaultyRadio
from radron.sim.faults.onboard import OnboardFaults
from radron.sim.faults.poisoners import Poisoners
from radron.sim.faults.poses import with_filter_errors
from radron.sim.faults.process import Agent, Crew, Life
from radron.sim.faults.recovery import Recovery
from radron.sim.faults.schedule import Schedule
from radron.sim.faults.tellers import Tellers
from radron.sim.faults.thieves import Thieves
from radron.sim.lockstep.members import SimulatedAuthority, SimulatedOperator, nonce_key_of
from radron.sim.lockstep.revoker import Revoker
from radron.sim.lockstep.sharedframes import SharedFrames
from radron.sim.lockstep.sharing import Folds, Readings, SignedRoots
from radron.sim.lockstep.telemetry import Telemetry
from radron.sim.scenario import Scenario
from radron.sim.scoring.aboard import Aboard
from radron.sim.scoring.framescore import FrameScore
from radron.sim.scoring.heard import KINDS
from radron.sim.scoring.moment import EPOCH_NS, Moment
from radron.sim.scoring.recorder import MAX_START_S, Recorder
from radron.sim.vehicle.autopilot import autopilots
from radron.sim.vehicle.multirotor import Multirotors
from radron.sim.vehicle.setpoints import in_world
from radron.sim.world.cameras import Cameras
from radron.sim.world.launch import launch_places
from radron.sim.world.localization import Localization
from radron.sim.world.movingframes import MovingFrames
from radron.sim.world.sightings import Sightings
from radron.sim.world.sources import Source, Sources, place_of
from radron.sim.world.streams import streams
from radron.sim.world.terrain import Terrain
from radron.sim.world.walls import Walls

TICK_NS = 50_000_000  # agents and autopilots step at 20 Hz
EXPOSE_TICKS = 2  # a camera is exposed for 0.1 s at the pose in the middle
READ_TICKS = 4  # cameras are read out at 5 Hz
COMMAND_AT_S = 0.5  # the operator's start command, after the agents have received each other's messages


class World:
    """The complete state of the simulated world and of the agents in it."""

    def __init__(self, scenario: Scenario, seed: int, listen: Sequence[str], make: Callable[..., Pilot]) -> None:
        """Build the world of a scenario at the start of a flight; errors as in ``flight.fly``.

        ``listen``: estimators without influence on the flight. ``make``: function that makes the pilots, as ``Pilot``.
        """
        check_playable(scenario.fault, scenario.name)
        mission = scenario.mission
        count = len(mission.drones)
        random = streams(seed, count)
        self.ticks = 0
        self._mission = mission
        names, layout = [drone.id for drone in mission.drones], [(drone.origin_m, drone.yaw_deg) for drone in mission.drones]
        self._faults = Schedule(scenario.fault, names, seed)
        self._frames = MovingFrames(scenario.localization, names, layout, mission.datum, TICK_NS * 1e-9, random)
        self._sightings: Sightings | None = None
        if scenario.sightings is not None:
            walls = Walls(scenario.walls) if scenario.walls else None
            self._sightings = Sightings(scenario.sightings, names, walls, TICK_NS * 1e-9, random.sightings)
        configs = [scenario.drone_file(name) for name in names]
        self._sources = Sources(scenario, MAX_START_S + scenario.end.longest_s(mission), random)
        self._sources_now: tuple[Source, ...] = ()
        nuclides = self._sources.nuclides
        self._cameras = Cameras(scenario, nuclides, configs, random, EPOCH_NS) if scenario.measured else None
        self._folder = TemporaryDirectory()  # also for agents that are started again
        if self._cameras is not None:
            configs = self._cameras.calibrated(configs, Path(self._folder.name))
        self._configs, self._listen, self._seed, self._make = configs, listen, seed, make
        self._computing = Computing(Folds(), SharedFrames(), Readings(), SignedRoots())
        self._authority = authority = SimulatedAuthority(seed)
        self._operator = SimulatedOperator(authority, mission.swarm, mission.mission_id)
        self._terrain = Terrain(scenario.terrain)
        position = self._terrain.on_ground(launch_places(scenario.start, mission, random.start))
        self._multirotors = Multirotors(scenario.vehicle, position, np.zeros(count), TICK_NS * 1e-9, random.vehicle)
        errors = Localization(scenario.localization, count, TICK_NS * 1e-9, random.localization)
        self._localization = with_filter_errors(scenario.fault, errors, TICK_NS * 1e-9)
        self._autopilots = autopilots(mission, self._frames.local(position), self._frames.yaw_rad, TICK_NS * 1e-9)
        world = (self._frames, self._localization, self._multirotors, self._autopilots, (scenario.camera, self._cameras))
        self._onboard = OnboardFaults(self._faults, EPOCH_NS, TICK_NS * 1e-9, *world)
        self._telemetry = Telemetry(self._multirotors, self._localization, self._frames, self._terrain, self._onboard, EPOCH_NS)
        self._radio = FaultyRadio(scenario.radio, names, random.radio, self._faults, TICK_NS * 1e-9)
        poisoners, trusts = Poisoners(self._faults, layout), [authority.trust(name) for name in names]
        self._tellers = Tellers(scenario.fault, self._faults, names, authority.signs(names), poisoners)
        self._forgers, self._thieves = Forgers(self._faults, names, trusts, poisoners), Thieves(self._faults, trusts)
        self._crowds = Crowds(self._faults, mission.swarm, trusts)
        self._old_commands = OldCommands(self._faults)
        self._revoker = Revoker(self._faults, names, self._operator, self._radio.exclude, self._onboard.clocks.own_ns)
        self._recovery = Recovery(mission.swarm, names, self._radio, self._tellers) if scenario.fault else None
        late = [any(isinstance(fault, Late) and name in fault.strikes(names) for fault in scenario.fault) for name in names]
        agents = [Agent(self._start(k), autopilot, late[k]) for k, autopilot in enumerate(self._autopilots)]
        self._crew = Crew(scenario.fault, self._faults, agents, self._start, self._gone, self._revoker.remind)
        scored = [Aboard(agent) for agent in agents]
        event_s = scenario.localization.event_s
        known = FrameScore(mission, scored[0], self._frames, event_s) if self._frames.moving else None
        self.recorder = Recorder(scenario, scored, self._frames, TICK_NS * 1e-9, scored[0].listeners, known)

    @property
    def pilots(self) -> list[Pilot]:
        """Pilots (decision part of the agents) of all drones; of a dead agent the last one."""
        return self._crew.pilots

    def close(self) -> None:
        """Remove the temporary files of the flight."""
        self._folder.cleanup()

    @property
    def time_s(self) -> float:
        """Seconds since the start of the simulation."""
        return self.ticks * TICK_NS * 1e-9

    def moment(self) -> Moment:
        """Return the state of the world after the last tick, for observers."""
        motion, agents = self._multirotors, self._crew.agents
        return Moment(
            time_s=self.time_s,
            position_m=self._terrain.above_ground(motion.position_m),
            velocity_mps=motion.velocity_mps,
            heading_rad=motion.yaw_rad,
            source=place_of(self._sources_now),
            pilots=[agent.pilot if agent.life is Life.RUNNING else None for agent in agents],
            commands=[agent.command for agent in agents],
            autopilots=self._autopilots,
            sent=[agent.sent for agent in agents],
            inboxes=self._radio.waiting,
            batteries=self._onboard.vehicles.levels,
            told_s=self._telemetry.told_s,
        )

    def describe(self) -> str:
        """Return a line of text with the mission stage of the first drone and the swarm's source estimate."""
        return self.recorder.describe()

    def tick(self) -> bool:
        """Simulate the world and all agents for one tick (50 ms); return True at the end of the flight."""
        now_ns = EPOCH_NS + self.ticks * TICK_NS
        self._faults.advance(self.time_s)
        self._crew.advance(now_ns)
        self._radio.advance(now_ns, self._multirotors.position_m)
        sources = self._sources_now = self._sources.at(self.time_s)
        measured = self._sense(now_ns, sources)
        if self.ticks == round(COMMAND_AT_S * 1e9 / TICK_NS):
            self._command(now_ns, [drone for drone, agent in enumerate(self._crew.agents) if agent.alive], Action.START)
        self._command(now_ns, self._crew.called(now_ns), Action.START)
        self._old_commands.advance(now_ns, partial(self._command, now_ns), self._again)
        running = {drone: agent.pilot for drone, agent in enumerate(self._crew.agents) if agent.life is Life.RUNNING}
        self._revoker.advance(now_ns, running)
        for drone, agent in enumerate(self._crew.agents):
            agent.command, agent.sent = None, 0
            if not agent.alive:
                self._radio.silence(drone)
                continue
            agent.readings += measured[drone]
            if self._crew.steps(drone, now_ns):
                self._step(drone, agent, now_ns)
        for drone, key, payload in self._thieves.publish(now_ns):
            for receiver in range(len(self._crew.agents)):  # the drone itself, too
                self._radio.send(drone, key, payload, now_ns, receiver)
        self._move()
        self.ticks += 1
        motion, error = self._multirotors, self._localization
        return self.recorder.sample(self.time_s, motion.position_m, motion.velocity_mps, sources, error.position_error_m)

    def _step(self, drone: int, agent: Agent, now_ns: int) -> None:
        """Step an agent: deliver its messages, publish its own, and pass on its command."""
        pilot, recovery, own_ns = agent.pilot, self._recovery, self._onboard.clocks.own_ns(drone, now_ns)
        self._publish(drone, agent.readings, now_ns)  # peers that ask get the versions already sent to all others
        burst = self._radio.receive(drone, now_ns)
        for key, payload in burst:
            if recovery is None or not recovery.hear(drone, key, payload, pilot, now_ns):
                pilot.receive(key, payload, own_ns)
        if burst:
            pilot.advance(own_ns)  # as its shell does after each burst, which takes work off the step
        step = pilot.step(own_ns)
        self._publish(drone, step.publications, now_ns)
        agent.command, agent.sent = step.command, len(agent.readings) + len(step.publications)
        agent.readings.clear()
        if recovery is not None:
            recovery.ask(drone, pilot, now_ns)
        self._autopilots[drone].command(step.command)

    def _publish(self, drone: int, publications: Sequence[tuple[str, bytes]], now_ns: int) -> None:
        """Send messages of a drone to all others, with the changes and additions of liars and forgers."""
        for key, payload in publications:
            for to, told in self._tellers.tell(drone, key, payload):
                self._radio.send(drone, key, told, now_ns, to)
            self._thieves.overhear(drone, key, payload)
            for forged in self._forgers.forged(drone, key, payload):
                self._radio.send(drone, key, forged, now_ns)
            for place, entry in self._crowds.beside(drone, key, payload, now_ns):
                self._radio.send(drone, place, entry, now_ns)
            if key.endswith(KINDS):
                self.recorder.take(drone, self._computing.read(key, payload))

    def _sense(self, now_ns: int, sources: Sequence[Source]) -> list[list[tuple[str, bytes]]]:
        """Pass telemetry, fixes, sightings and readouts to the pilots; return the publications of each."""
        self._onboard.vehicles.step()
        clocks = self._onboard.clocks
        for drone, pilot in enumerate(self.pilots):
            own_ns = clocks.own_ns(drone, now_ns)
            pilot.observe_clock(clocks.ahead_ns(drone, now_ns), own_ns)
        self._telemetry.tell(now_ns, self.pilots, self._autopilots)
        published: list[list[tuple[str, bytes]]] = [[] for _ in self.pilots]
        self._localize(now_ns, published)
        if self._cameras is None:
            return published
        if self.ticks % EXPOSE_TICKS == EXPOSE_TICKS // 2:
            half_ns = EXPOSE_TICKS * TICK_NS // 2
            for drone in range(len(self.pilots)):
                self._cameras.expose(drone, now_ns - half_ns, now_ns + half_ns, self._multirotors, sources)
        if self.ticks % READ_TICKS != 0 or self.ticks == 0:
            return published
        for drone, pilot in enumerate(self.pilots):
            readout = self._onboard.readout(drone, self._cameras.read_out(drone))
            if readout is not None:
                published[drone] += pilot.observe_detector(readout)
        return published

    def _localize(self, now_ns: int, published: list[list[tuple[str, bytes]]]) -> None:
        """Pass fixes and relative observations to the pilots."""
        motion = self._multirotors
        for drone, receiver in enumerate(self._frames.receiver):
            fix = None if receiver is None else receiver.fix(self._onboard.clocks.own_ns(drone, now_ns), motion.position_m[drone])
            if fix is not None:
                published[drone] += self.pilots[drone].observe_fix(fix)
        if self._sightings is None:
            return
        if self._sightings.due(self.ticks):
            attitudes = [motion.quaternion(drone) for drone in range(len(self.pilots))]
            self._sightings.look(now_ns, motion.position_m, attitudes)
        for drone, seen in self._sightings.take(now_ns):
            published[drone] += self.pilots[drone].observe_sightings(self._onboard.clocks.restamped_sightings(drone, seen))

    def _command(self, now_ns: int, drones: Sequence[int], action: Action) -> bytes | None:
        """Give the operator's command to some drones; return the payload sent."""
        if not drones:
            return None
        own_ns = {drone: self._onboard.clocks.own_ns(drone, now_ns) for drone in drones}
        tickets = {self._configs[drone].id: self.pilots[drone].ticket(own_ns[drone]) for drone in drones}
        payload = self._operator.ordered(now_ns, action, tickets)
        for drone in drones:
            self.pilots[drone].receive(self._operator.key, payload, own_ns[drone])
        return payload

    def _again(self, now_ns: int, drone: int, payload: bytes) -> None:
        """Deliver an earlier command once more."""
        self.pilots[drone].receive(self._operator.key, payload, self._onboard.clocks.own_ns(drone, now_ns))

    def _start(self, drone: int, starts: int = 0, memory: Memory | None = None) -> Pilot:
        """Make the pilot of a drone's agent after this number of earlier starts."""
        self._onboard.clocks.begin(drone)
        boot = f"{self._seed & 0xFFFFFFFF:08x}{starts << 16 | drone:08x}"
        listeners = self._listen if drone == 0 else ()
        config = self._configs[drone]
        trust, nonce_key = self._authority.trust(config.id), nonce_key_of(self._seed, config.id, starts)
        given = self._mission, config, boot, listeners, memory, trust
        return self._make(*given, nonce_key=nonce_key, computing=self._computing)

    def _gone(self, drone: int) -> None:
        """Reset radio and recovery of an agent that has died, or begins."""
        self._radio.silence(drone)
        if self._recovery is not None:
            self._recovery.begin_anew(drone)

    def _move(self) -> None:
        motion, error = self._multirotors, self._localization
        flat = self._terrain.flat and not self._frames.moving  # in a frame that moves vertically, home is not at ground level
        heights = self._terrain.above_ground(motion.position_m)[:, 2].tolist()
        told = zip(self._autopilots, self._telemetry.estimated_m, heights, self._telemetry.velocity_mps, strict=True)
        for autopilot, estimated, height_m, velocity in told:
            autopilot.step(estimated, estimated[2] - height_m, velocity)  # lands on the true ground, not at its estimate
        targets = [autopilot.target for autopilot in self._autopilots]
        setpoints = in_world(targets, [target.position for target in targets], self._frames, error.yaw_error_rad)
        grounded = np.array([autopilot.grounded for autopilot in self._autopilots])
        # The autopilot controls its estimates, not its true position and velocity.
        motion.step(setpoints, grounded, error.position_error_m, error.velocity_error_mps)
        if not flat or motion.any_falls or any(autopilot.descends for autopilot in self._autopilots):
            motion.rest_on(motion.position_m[:, 2] - self._terrain.above_ground(motion.position_m)[:, 2])
        error.step()
        self._onboard.poses.step()
        self._frames.step(self.time_s, motion.position_m)
        for autopilot, reframing in zip(self._autopilots, self._frames.reframing, strict=True):
            if reframing is not None:
                autopilot.reframe(reframing)
