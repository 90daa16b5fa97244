"""The shell of one drone: Zenoh, PX4 and the camera wired to the pilot, in one event loop.

All calls of the pilot are made in the loop's thread: messages, telemetry and readouts as they come, a step each 50 ms. Setpoints
leave with the step that computed them and in no other way, so that the autopilot notices when the steps stop.

What goes wrong in a handler of messages, telemetry or readouts is logged, once for each kind, and counted; the flight goes on.
An exception out of the pilot's step is another matter: nobody knows what state it left behind. It ends the agent, the autopilot's
failsafe takes over, and the service manager starts the agent anew, which then rejoins the flight.
"""

from __future__ import annotations

import asyncio
import gc
import os
import time
from collections import Counter
from collections.abc import Callable, Coroutine
from functools import partial

from agent.beat import Beat
from agent.config import DetectorConfig, DroneConfig, MissionConfig
from agent.detector.drivers import open_detector
from agent.detector.readout import Detector, first_hits
from agent.errors import ConfigError, FlightRecordError
from agent.flight.header import FlightHeader
from agent.flight.recorded import RecordedPilot
from agent.flight.recorder import FlightRecorder
from agent.guard import Guard
from agent.keeper import Keeper
from agent.logs import Logger
from agent.pilot import Pilot
from agent.recovery import recover
from agent.sightings import SightingsFeed
from agent.statefile import State
from agent.vehicle.interface import GnssFix
from agent.vehicle.px4 import Px4Vehicle
from protocol.messages import Stage
from protocol.session import Mesh, MeshConfig

PERIOD_S = 0.05
LOOK_S = 0.5  # between two looks at what is wrong
LATE_STEP_S = 0.2  # by which a step must be late to be reported; the autopilot's patience is 1 s
LATE_S = 5.0  # for which it is reported
CLOSE_S = 1.2
MOST_HITS = 20_000  # of a readout; ten times as many, as a noisy camera can deliver, keep the loop from stepping for too long
COUNTERS_S = 10.0
DetectorOf = Callable[[DetectorConfig], Detector | None]


class Node:
    """One agent, from its start to its end."""

    def __init__(
        self,
        drone: DroneConfig,
        mission: MissionConfig,
        beat: Beat,
        log: Logger,
        detector_of: DetectorOf = open_detector,
    ) -> None:
        """``beat``: told of every step. ``detector_of``: opens the camera; a test puts another one in its place."""
        self._drone = drone
        self._mission = mission
        self._beat = beat
        self._log = log
        self._detector_of = detector_of
        self._guard = Guard(log)
        self._keeper = Keeper(drone.state, drone.id, log)
        self._stage: Stage | None = None
        self._told: dict[str, tuple[str, ...]] = {"warning": (), "problem": ()}
        self._late_s = float("-inf")  # when a step was last late
        self._tasks: list[asyncio.Task[None]] = []
        self._closers: list[Callable[[], Coroutine[None, None, None]]] = []
        self.counters: Counter[str] = Counter()
        self._pilot: Pilot | RecordedPilot
        self._mesh: Mesh
        self._vehicle: Px4Vehicle
        self._detector: Detector | None = None
        self._sightings: SightingsFeed | None = None
        self._recorder: FlightRecorder | None = None
        self._unrecorded: tuple[str, ...] = ()  # why there is no recorder

    async def run(self) -> None:
        """Fly until cancelled.

        Raises:
            RadronError, ProtocolError: something that the user can mend: no vehicle, a port in use, no camera module.
            Exception: the pilot's step failed.
        """
        try:
            await self._open()
            await self._fly()
        finally:
            self._beat.rest()
            await self._close()

    async def _open(self) -> None:
        """Everything in its order; what was opened before a failure is closed by ``run``."""
        boot = os.urandom(8).hex()
        saved = self._keeper.load()
        self._pilot = self._make_pilot(boot, saved)
        guarded = self._guard.call
        self._detector = self._detector_of(self._drone.detector)
        if self._detector is not None:
            self._closers.append(self._detector.close)
        if self._drone.sightings.address is not None:
            self._sightings = SightingsFeed(self._drone.sightings.address)
            self._closers.append(self._sightings.close)
        self._mesh = await Mesh.open(
            mesh_config(self._drone, self._mission),
            self._mission.swarm,
            self._drone.id,
            receive=guarded("messages", lambda key, payload: self._pilot.receive(key, payload, time.time_ns()), None),
            drained=guarded("log entries", lambda: self._pilot.advance(time.time_ns()), None),
            answer=guarded("log queries", self._pilot.log_answer, []),
        )
        self._closers.append(self._mesh.close)
        self._log.info("mesh is up", boot=boot, mission=self._mission.mission_id)
        ceiling_m, exact = self._mission.area.ceiling_m, self._frame_is_exact
        self._vehicle = Px4Vehicle(self._drone.vehicle, ceiling_m, saved.launch, exact=exact)
        self._closers.append(self._vehicle.close)
        self._vehicle.on_state(guarded("telemetry", self._pilot.observe_vehicle, None))
        self._publish = guarded("publications", self._mesh.publish, None)
        if self._wants_fixes:
            self._vehicle.on_fix(guarded("fixes", self._take_fix, None))
        await self._vehicle.connect()
        self._log.info("vehicle is connected", address=self._drone.vehicle.address)
        if self._detector is not None:
            self._start("the camera", partial(self._read, self._detector))
        if self._sightings is not None:
            self._start("the sensor that sees the other drones", partial(self._see, self._sightings))
        self._start("recovery of the log", self._recover)
        self._send_command = guarded("commands", self._vehicle.command, None)
        gc.collect()
        gc.freeze()  # to search what was loaded until now takes 0.1 s each time, in the midst of the flight, and finds nothing
        self._beat.tell("READY=1")

    def _make_pilot(self, boot: str, saved: State) -> Pilot | RecordedPilot:
        """A recorded one if records are wanted. Where they cannot be written that stands against a start, but not against
        rejoining a flight.
        """
        records = self._drone.recorder
        pilot = Pilot(self._mission, self._drone, boot, memory=saved.memory)
        if records.folder is None:
            return pilot
        header = FlightHeader.of(self._mission, self._drone, boot, time.time_ns(), saved.memory)
        try:
            self._recorder = FlightRecorder(records.folder, records.limit_mb, header)
        except FlightRecordError as error:
            self._unrecorded = (str(error),)
            return pilot
        return RecordedPilot(pilot, self._recorder)

    async def _close(self) -> None:
        """Close everything that is open, at the same time and within a bounded one."""
        for task in self._tasks:
            task.cancel()
        closing = [*self._tasks, *(close() for close in self._closers)]
        if self._recorder is not None:
            closing.append(asyncio.to_thread(self._recorder.close))
        try:
            async with asyncio.timeout(CLOSE_S):
                outcomes = await asyncio.gather(*closing, return_exceptions=True)
        except TimeoutError:
            self._log.error("not everything could be closed in time")
            return
        for outcome in outcomes:
            if isinstance(outcome, Exception):
                self._log.error("not closed cleanly", error=repr(outcome))

    async def _fly(self) -> None:
        """A step each 50 ms by absolute deadlines. Steps whose time is past are left out and counted, never made up for."""
        loop = asyncio.get_running_loop()
        due_s = look_s = counters_s = loop.time()
        while True:
            now_s = loop.time()
            if now_s >= look_s:
                look_s = now_s + LOOK_S
                self._look(now_s)
            if now_s >= counters_s:
                counters_s = now_s + COUNTERS_S
                self._log.debug("counters", node=self.counters, mesh=self._mesh.counters, pilot=self._pilot.counters)
            self._step()
            due_s += PERIOD_S
            behind_s = loop.time() - due_s
            if behind_s > 0.0:
                missed = int(behind_s / PERIOD_S) + 1
                due_s += missed * PERIOD_S
                self.counters["steps_left_out"] += missed
                if behind_s > LATE_STEP_S:
                    self._late_s = loop.time()
            await asyncio.sleep(due_s - loop.time())

    def _step(self) -> None:
        """Decide and send. Nothing is sent that was computed before a stall."""
        self._beat.check()
        step = self._pilot.step(time.time_ns())
        self._beat.beat()
        self._send_command(step.command)
        for key, payload in step.publications:
            self._publish(key, payload)
        stage = self._pilot.stage
        if stage is not self._stage:
            self._log.info("stage", stage=str(stage), before=str(self._stage))
            self._beat.tell(f"STATUS={stage}")
            self._stage = stage

    async def _read(self, detector: Detector) -> None:
        observe = self._guard.call("readouts", self._pilot.observe_detector, [])
        async for readout in detector.readouts():
            for key, payload in observe(first_hits(readout, MOST_HITS)):
                self._publish(key, payload)

    async def _see(self, sensor: SightingsFeed) -> None:
        observe = self._guard.call("sightings", self._pilot.observe_sightings, [])
        async for seen in sensor.sightings():
            for key, payload in observe(seen):
                self._publish(key, payload)

    def _take_fix(self, fix: GnssFix) -> None:
        for key, payload in self._pilot.observe_fix(fix):
            self._publish(key, payload)

    @property
    def _wants_fixes(self) -> bool:
        """Whether fixes tell anybody anything: where this drone's frame is estimated, and the mission lies somewhere on Earth."""
        return not self._frame_is_exact and self._mission.datum is not None

    @property
    def _frame_is_exact(self) -> bool:
        return next(member.is_exact for member in self._mission.drones if member.id == self._drone.id)

    async def _recover(self) -> None:
        members = [member.id for member in self._mission.drones]
        phase = members.index(self._drone.id) / len(members)
        await recover(lambda: self._mesh.alive & set(members), self._pilot.log_summary, self._mesh.ask, phase)

    def _start(self, kind: str, work: Callable[[], Coroutine[None, None, None]]) -> None:
        self._tasks.append(asyncio.create_task(self._guard.work(kind, work), name=kind))

    def _look(self, now_s: float) -> None:
        """Tell the pilot what is wrong, where that has changed, and keep what must survive a restart."""
        self._tell("warning", self._warnings(now_s), self._pilot.warn)
        self._tell("problem", self._vehicle.problems + self._unrecorded, self._pilot.block)
        memory = self._pilot.memory
        # On the ground the launch place changes with every look, and nobody needs it.
        self._keeper.keep(State(memory=memory, launch=self._vehicle.launch if memory is not None else None))

    def _tell(self, event: str, problems: tuple[str, ...], tell: Callable[[tuple[str, ...]], None]) -> None:
        before = self._told[event]
        if problems == before:
            return
        self._told[event] = problems
        tell(problems)
        for text in problems:
            if text not in before:
                self._log.warning(event, text=text)
        for text in before:
            if text not in problems:
                self._log.info(f"{event} is over", text=text)

    def _warnings(self, now_s: float) -> tuple[str, ...]:
        endpoints = self._drone.mesh.endpoints
        heard = {self._drone.id, *self._mesh.alive}
        unheard = [member.id for member in self._mission.drones if member.id not in heard]
        problems = [f"no contact with {name} ({endpoints.get(name, 'no endpoint given')})" for name in unheard]
        for part in (self._detector, self._sightings, self._recorder, self._guard):
            problems += part.problems if part is not None else ()
        if self._keeper.problem is not None:
            problems.append(self._keeper.problem)
        if now_s - self._late_s < LATE_S:
            problems.append(f"the computer is too slow: setpoints were more than {LATE_STEP_S:g} s late in the last seconds")
        return tuple(problems)


def mesh_config(drone: DroneConfig, mission: MissionConfig) -> MeshConfig:
    """Listen at the drone's own endpoint, and dial those of the drones before it in the mission: never both ways.

    Raises:
        ConfigError: it has no endpoint.
    """
    endpoints = drone.mesh.endpoints
    listen = drone.mesh.listen or endpoints.get(drone.id)
    if listen is None:
        raise ConfigError(f'mesh.endpoints has none for {drone.id}: give it one, such as "tcp/10.7.1.11:7447"')
    members = [member.id for member in mission.drones]
    before = members[: members.index(drone.id)]
    return MeshConfig(listen=listen, connect=tuple(endpoints[name] for name in before if name in endpoints))
